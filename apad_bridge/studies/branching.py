"""Branches of a run: its mission up to a moment as it was flown, and from there on in virtual time by other rules.

Each branch stands beside one that changes nothing, so their difference is that of the rules alone.

- A run in virtual time is flown again up to the moment. Its stimuli must be those of the journal, so the unchanged branch
  has the run's own figures.
- Any other run, or one that does not repeat, is continued from its records: each aMussel lives again through its recorded
  stimuli, the mission goes on from its newest snapshot, and a simulated aPad is at rest where the real one was seen last.
"""

from __future__ import annotations

import json
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any

from agents.hosting.in_process import InProcessHost
from agents.mussel.outputs import SoundSent, Truth, WifiSent
from agents.mussel.stimuli import AgentStimulus, WasReset, from_json
from agents.packet_medium import Medium
from agents.time_scale import TICK_MS, AgentMs, MissionMs
from apad_bridge.assembly import fleet_parts, flight_parts
from apad_bridge.assembly.capacity_bounds import battery_worth_min
from apad_bridge.assembly.division import members
from apad_bridge.assembly.flight_config import FlightConfig, flight_config
from apad_bridge.assembly.safety import safety_of
from apad_bridge.events.fleet_events import ProcessDied, Stimulated
from apad_bridge.events.mission_events import Phase
from apad_bridge.mission.energy_exchange import EnergyExchange
from apad_bridge.mission.facts import AMusselHeard, StandDownRequested
from apad_bridge.planning import registry
from apad_bridge.planning.dispatch_rule import ServiceRules
from apad_bridge.records.journal import JournalContents, read_journal
from apad_bridge.records.run_directory import RunDirectory
from apad_bridge.records.run_state import RunState
from apad_bridge.records.uptime import UptimeMeter
from apad_bridge.records.uptime_figures import uptime_figures
from apad_bridge.runs.in_memory import MemoryRecorder, mission_figures, open_lockstep
from apad_bridge.runs.several.lockstep import Exchange, LockstepRunner, MemberFlight
from apad_bridge.runs.start_state import find_resume_point, with_apad_as_seen
from apad_bridge.runs.supervisor_lock import supervisor_of
from apad_bridge.scenario.blocks.mission_options import Strategies
from apad_bridge.scenario.errors import ScenarioError, UserError
from apad_bridge.scenario.firmware_config import takes_samples
from apad_bridge.scenario.flight_readiness import check_code
from apad_bridge.scenario.hull_in_flow import surface_of
from apad_bridge.scenario.loader import with_values
from apad_bridge.scenario.run_options import RunOptions, TimeSource
from apad_bridge.scenario.schema import Scenario
from apad_bridge.scenario.starts import starts_of
from apad_bridge.supervisor.clock import AsFastAsPossible
from apad_bridge.supervisor.context import FlightContext
from apad_bridge.supervisor.run_spec import RunSpec
from apad_bridge.supervisor.sample_collection import SampleCollection
from apad_bridge.supervisor.supervisor import LearnedState
from apad_bridge.world.apad.in_process import InProcessVehicle
from apad_bridge.world.apad.simulated_apad import SimulatedAPad
from apad_bridge.world.contacts import Contacts
from apad_bridge.world.simulated_fleet import FlightFleet
from apad_bridge.world.world import World
from firmware_model.stimuli import ResetCause

CHANGEABLE = (
    *(it.name for it in (*fields(Strategies), *fields(ServiceRules))),
    "costs",
)
"""The keys of a scenario's `mission` that decide plans, and can change while it flies."""
FIGURES = {
    "amussels_lost": "lost",
    "samples_taken": "samples taken",
    "uptime_submerged.mean": "submerged %",
    "uptime_submerged.min": "submerged %, least",
    "uptime_paper.mean": "uptime %",
    "uptime_paper.min": "uptime %, least",
    "planned_m": "way planned m",
    "cost_m": "way flown m",
    "services": "services",
    "dead_time_s": "dead s",
    "final_charge_mean": "final charge",
    "charge_gain_mean": "charge, end - begin",
    "uptime_equal_charge": "uptime % at equal charge",
}
"""The compared figures of summary.json, and their names for people."""
LOST_APAD = "it is lost in this branch"
_BATTERY_HELD_MS = 60_000
_FELT: tuple[type[Stimulated | ProcessDied], ...] = (Stimulated, ProcessDied)
"""The events that reach an aMussel."""


@dataclass(frozen=True, slots=True)
class Turn:
    """The moment of a branch, and what changes there."""

    at_ms: MissionMs
    rules: Mapping[str, Any] = field(default_factory=dict)
    """New values by key of `mission`; see `CHANGEABLE`."""
    lost_apad: str | None = None
    """The name of an aPad that does nothing any more, and keeps what it has docked."""


@dataclass(frozen=True, slots=True)
class Branches:
    """The figures of the run as flown, and of the branches without and with the change; keys are those of `FIGURES`.

    As flown they are None for a run without a summary.
    """

    flown: dict[str, float | None]
    unchanged: dict[str, float | None]
    changed: dict[str, float | None]
    is_exact: bool
    """The mission up to the moment is the run's own, tick by tick; otherwise it was continued from the records."""
    has_our_firmware: bool = False
    """The branches flew our firmware in place of the run's own."""


@dataclass(frozen=True, slots=True)
class _Opened:
    """The flights of a run at the moment of the branch."""

    scenario: Scenario
    runner: LockstepRunner
    meter: UptimeMeter
    """It counts the uptimes of all aPads' flights together."""

    def figures(self) -> dict[str, float | None]:
        now_ms = max(it.flight.now_ms for it in self.runner.flights.values())
        figures = uptime_figures(self.meter, now_ms, battery_min=battery_worth_min(self.scenario))
        if not takes_samples(self.scenario.board):
            figures["samples_taken"] = None
        for it in self.runner.flights.values():
            for key, value in mission_figures(it.flight.supervisor.mission.state).items():
                figures[key] = figures.get(key, 0) + value
        return _compared(figures)


@dataclass(frozen=True, slots=True)
class _Relived:
    """The aMussels at the moment of the branch, and what a supervisor learned of them."""

    fleet: FlightFleet
    learned: LearnedState
    docked: tuple[int, ...]


def branch(path: Path, turn: Turn, trust: registry.Trust | None = None) -> Branches:
    """Flies both branches of the run in this directory. UserError for a run or a moment that has none.

    Strategies in files are executed with `trust` alone.
    """
    try:
        directory = RunDirectory(path)
        scenario, options = directory.scenario_as_flown(), RunOptions.load(path)
        summary = directory.read_summary() or {}
        names = [member.name for member in members(scenario, starts_of(scenario))]
        journals = {name: read_journal(directory.of_apad(name, len(names)).journal) for name in names}
    except (OSError, ValueError) as error:
        raise UserError(f"{path}: no run: {str(error).splitlines()[0]}") from error
    if any(supervisor_of(directory.of_apad(name, len(names)).path) is not None for name in names):
        raise UserError(f"{path}: the run flies still: musselbed abort {path} ends it")
    changed = _checked(scenario, turn, names, trust)
    if options.without_mission:
        raise UserError(f"{path}: a script or a person flew it, and no strategy planned")
    # A run that a crash ended has no summary: it lasted as long as its journal, and has no figures as flown.
    lasted_s = summary.get("mission_s", max(it.last_ms for it in journals.values()) / 1000)
    if not 0 < turn.at_ms < lasted_s * 1000:
        raise UserError(f"--at {turn.at_ms / 1000:g} s: the run lasted {lasted_s:g} s")
    opened = _again(scenario, turn.at_ms, journals, trust) if options.time is TimeSource.ASAP else None
    is_exact = opened is not None
    if opened is None:
        opened = _from_records(scenario, turn.at_ms, journals, trust)
    opened.runner.run()
    unchanged = opened.figures()
    again = _again(scenario, turn.at_ms, journals, trust) if is_exact else None
    opened = again or _from_records(scenario, turn.at_ms, journals, trust)
    _turn(opened, changed, turn, trust)
    opened.runner.run()
    others = bool(scenario.fleet.firmware)
    return Branches(_compared(summary), unchanged, opened.figures(), is_exact, has_our_firmware=others)


def _checked(scenario: Scenario, turn: Turn, names: Sequence[str], trust: registry.Trust | None) -> Scenario:
    """The scenario with the other rules, whose strategies can be loaded, as its own can."""
    if unknown := sorted(set(turn.rules) - set(CHANGEABLE)):
        raise UserError(f"--set {unknown[0]}: what can change in flight is {', '.join(CHANGEABLE)}")
    if turn.lost_apad is not None and turn.lost_apad not in names:
        raise UserError(f"--lose-apad {turn.lost_apad}: the run's aPads are {', '.join(names)}")
    try:
        changed = with_values(
            scenario, {f"mission.{key}": it for key, it in turn.rules.items()}, scenario.name
        )
        check_code(changed, scenario.name, trust)
        check_code(scenario, scenario.name, trust)
    except ScenarioError as error:
        raise UserError(error.lines[0]) from error
    return changed


def _turn(opened: _Opened, changed: Scenario, turn: Turn, trust: registry.Trust | None) -> None:
    for name, it in opened.runner.flights.items():
        supervisor = it.flight.supervisor
        assert isinstance(supervisor.mission, EnergyExchange)
        supervisor.mission.change_planning(flight_parts.plan_rules(changed, trust))
        if name == turn.lost_apad:
            supervisor.receive(StandDownRequested(it.flight.now_ms, LOST_APAD))


def _again(
    scenario: Scenario,
    at_ms: MissionMs,
    journals: Mapping[str, JournalContents],
    trust: registry.Trust | None,
) -> _Opened | None:
    """The flights of a run in virtual time, flown again up to the moment; None if their stimuli are not those recorded."""
    meter = UptimeMeter.for_scenario(scenario)
    opened = open_lockstep(
        members(scenario, starts_of(scenario)), scenario.sharing, lambda it: MemoryRecorder(it, meter), trust
    )
    opened.runner.run(at_ms)
    for name, recorder in opened.recorders.items():
        if _stimuli(recorder.journal, at_ms) != _stimuli(journals[name], at_ms):
            return None
    return _Opened(scenario, opened.runner, meter)


def _stimuli(journal: JournalContents, at_ms: MissionMs) -> list[tuple[int, int, int, str]]:
    """The journal's stimuli before the moment, in one order."""
    return sorted(
        (t, it.id, it.agent_ms, json.dumps(it.wire) if isinstance(it, Stimulated) else it.cause)
        for t, it in journal.events(*_FELT)
        if t < at_ms
    )


def _from_records(
    scenario: Scenario,
    at_ms: MissionMs,
    journals: Mapping[str, JournalContents],
    trust: registry.Trust | None,
) -> _Opened:
    """The flight of a single aPad, continued from its records at the tick of the moment."""
    if len(journals) > 1:
        raise UserError("a run of several aPads branches if it was flown in virtual time and repeats")
    if scenario.water is not None:
        raise UserError("a run by sound branches if it was flown in virtual time and repeats")
    ((name, journal),) = journals.items()
    at_ms = MissionMs(at_ms // TICK_MS * TICK_MS)
    journal = journal.until(at_ms)
    state = RunState.of(scenario, journal)
    if state.presences:
        raise UserError("real aMussels, or retired ones, cannot go on in virtual time")
    point = find_resume_point(state, epoch=2, gap_ms=0)
    if point.state.phase in (Phase.COMMANDED, Phase.ENDED, Phase.STANDS_DOWN):
        raise UserError(
            f"at {at_ms / 1000:g} s no strategy planned: the mission was {point.state.phase.value}"
        )
    recorder, config = MemoryRecorder(scenario), flight_config(scenario, trust)
    relived = _relive(scenario, config, journal, at_ms, recorder)
    vehicle = InProcessVehicle(_apad_at(scenario, state, at_ms))
    context = FlightContext(
        vehicle=vehicle,
        pace=AsFastAsPossible(),
        world=World(relived.fleet, contacts=Contacts(relived.docked)),
        safety=safety_of(scenario),
    )
    flight = flight_parts.flight(
        config,
        context,
        recorder,
        RunSpec(replace(point, now_ms=at_ms), relived.learned),
        SampleCollection(config.ids),
    )
    flights = {name: MemberFlight(scenario.apad.start_m, flight, recorder)}
    runner = LockstepRunner(flights, Exchange({name: config.ids}), None)
    return _Opened(scenario, runner, recorder.meter)


def _relive(
    scenario: Scenario,
    config: FlightConfig,
    journal: JournalContents,
    at_ms: MissionMs,
    recorder: MemoryRecorder,
) -> _Relived:
    """Has each aMussel live through its recorded stimuli, tick by tick up to the moment, and hears what they send."""
    initial_states = fleet_parts.initial_states(scenario, starts_of(scenario))
    fleet = fleet_parts.fleet_of(
        config,
        InProcessHost(fleet_parts.fleet_config(config), initial_states),
        dict.fromkeys(initial_states, 0),
    )
    learned = flight_parts.initial_learned_state(config)
    # It is told no position, so its mission orders nothing.
    listener = flight_parts.supervisor(config, RunSpec(learned=learned))
    felt: dict[int, list[Stimulated | ProcessDied]] = defaultdict(list)
    for t, event in journal.events(*_FELT):
        felt[-(-t // TICK_MS) * TICK_MS].append(event)
    newest: dict[int, Truth] = {}
    for now_ms in map(MissionMs, range(0, at_ms + 1, TICK_MS)):
        for result in fleet.water.advance(now_ms):
            match result:
                case WifiSent(sent_ms, _, data):
                    listener.receive(AMusselHeard(Medium.WIFI, fleet.mission_ms(sent_ms), data))
                case SoundSent(sent_ms, _, data):
                    listener.receive(AMusselHeard(Medium.SOUND, fleet.mission_ms(sent_ms), data))
        truths = fleet.water.take_truths()
        recorder.truths(truths)
        newest.update((truth.agent_id, truth) for truth in truths)
        listener.advance(now_ms)
        for event in felt.get(now_ms, ()):
            stimulus: AgentStimulus
            if isinstance(event, Stimulated):
                stimulus = from_json(event.wire)
            elif event.gave_up is None:
                stimulus = WasReset(ResetCause[event.cause])
            else:
                raise UserError(f"aMussel {event.id} died for good before {at_ms / 1000:g} s")
            fleet.coordinator.receive_at(event.id, stimulus, AgentMs(event.agent_ms))
    docked = tuple(agent_id for agent_id, truth in newest.items() if truth.physical.docked)
    return _Relived(fleet, learned, docked)


def _apad_at(scenario: Scenario, state: RunState, at_ms: MissionMs) -> SimulatedAPad:
    """A simulated aPad at rest where the journal last saw the real one, with its battery and its docked aMussels."""
    if (seen := with_apad_as_seen(scenario, state.apad)) is None:
        raise UserError(f"the aPad was not seen before {at_ms / 1000:g} s")
    config, home_m, sea = seen.apad, seen.area.home_m, surface_of(scenario)
    apad = SimulatedAPad(config, flight_parts.misses(scenario), home_m, dict(state.mission.docked), sea)
    for now_ms in [*range(0, at_ms, _BATTERY_HELD_MS), at_ms]:
        # It waits there from time 0 on, and what it draws meanwhile is given back.
        apad.advance(now_ms)
        apad.change_battery(config.battery.start_fraction - apad.battery.fraction, now_ms)
    return apad


def _compared(figures: Mapping[str, Any]) -> dict[str, float | None]:
    found: dict[str, float | None] = {}
    for key in FIGURES:
        value: Any = figures
        for part in key.split("."):
            value = None if value is None else value.get(part)
        found[key] = value
    return found
