"""Flies a whole mission in virtual time and in this process, without files: for studies of many configurations."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from agents.hosting.in_process import InProcessHost
from agents.mussel.outputs import Truth
from agents.time_scale import MissionMs
from agents.water.sea import Sea
from agents.water.sea_client import RemoteSea
from apad_bridge.assembly import fleet_parts, flight_parts
from apad_bridge.assembly.capacity_bounds import battery_worth_min
from apad_bridge.assembly.division import Member
from apad_bridge.assembly.flight_config import flight_config
from apad_bridge.beliefs.belief import Belief
from apad_bridge.events.event import Event
from apad_bridge.events.fleet_events import PresenceChanged
from apad_bridge.events.mission_events import MissionState
from apad_bridge.mission.facts import PlacedSample
from apad_bridge.planning.registry import Trust
from apad_bridge.records.journal import Entry, JournalContents
from apad_bridge.records.uptime import UptimeMeter
from apad_bridge.records.uptime_figures import uptime_figures
from apad_bridge.runs.flying import in_process_context
from apad_bridge.runs.several.lockstep import Join, LockstepRunner, MemberFlight
from apad_bridge.scenario.another_apad import Sharing
from apad_bridge.scenario.schema import Scenario
from apad_bridge.scenario.starts import starts_of
from apad_bridge.supervisor.context import FlightContext
from apad_bridge.supervisor.loop import Flight
from apad_bridge.supervisor.run_spec import FROM_START, RunSpec
from apad_bridge.supervisor.sample_collection import SampleCollection
from apad_bridge.vehicle.commands import BatteryReported, PoseReported
from firmware_model.packets.sample_record import SampleRecord


class MemoryRecorder:
    """Keeps the events and the uploaded samples, and counts uptimes from the truths."""

    def __init__(self, scenario: Scenario, meter: UptimeMeter | None = None) -> None:
        self._scale = scenario.time_scale
        self.meter = meter or UptimeMeter.for_scenario(scenario)
        self.battery_min = battery_worth_min(scenario)
        """The parameter of `uptime_figures`."""
        self.journal = JournalContents([], 0)
        self.taken: dict[int, int] = {}
        """The number of samples that each aMussel has ever taken, by id."""
        self.uploaded: dict[int, list[SampleRecord]] = {}
        """The uploaded samples by aMussel, in the order of their arrival."""

    def event(self, at_ms: MissionMs, event: Event) -> None:
        self.journal.entries.append(Entry(at_ms, event))
        if isinstance(event, PresenceChanged):
            self.meter.set_presence(event.id, event.is_, self._scale.agent_ms(at_ms))

    def truths(self, truths: list[Truth]) -> None:
        for truth in truths:
            self.meter.take(truth)
            self.taken[truth.agent_id] = truth.physical.samples

    def samples(self, agent_id: int, samples: Sequence[PlacedSample]) -> None:
        self.uploaded.setdefault(agent_id, []).extend(it.record for it in samples)

    def tick(
        self,
        now_ms: MissionMs,
        beliefs: list[Belief],
        pose: PoseReported | None,
        battery: BatteryReported | None,
        primitive: str,
        docks: tuple[int | None, ...],
        dropped: Callable[[], Counter[str]],
    ) -> None:
        pass


def open_flight(
    scenario: Scenario,
    spec: RunSpec = FROM_START,
    join: Callable[[FlightContext], FlightContext] = lambda context: context,
    recorder_of: Callable[[Scenario], MemoryRecorder] = MemoryRecorder,
    sea: Sea | RemoteSea | None = None,
    trust: Trust | None = None,
) -> tuple[Flight, MemoryRecorder]:
    """Opens a flight that is ready to `run`; returns it and its recorder.

    `join` changes the flight's context before the flight is built. `sea` is the one that several flights share. Strategies
    in files are executed with `trust` alone.
    """
    config, initial_states = (
        flight_config(scenario, trust),
        fleet_parts.initial_states(scenario, starts_of(scenario)),
    )
    host = InProcessHost(fleet_parts.fleet_config(config), initial_states)
    fleet = fleet_parts.fleet_of(config, host, dict.fromkeys(initial_states, 0), sea=sea)
    context = join(in_process_context(config, fleet))
    recorder = recorder_of(scenario)
    return flight_parts.flight(config, context, recorder, spec, SampleCollection(config.ids)), recorder


def fly_in_memory(scenario: Scenario) -> tuple[dict[str, Any], MemoryRecorder]:
    """Returns the summary's figures (those of `uptime_figures`, and the mission's), and the recorder."""
    flight, recorder = open_flight(scenario)
    flight.run()
    return _figures(flight, recorder), recorder


def _figures(flight: Flight, recorder: MemoryRecorder) -> dict[str, Any]:
    figures = uptime_figures(recorder.meter, flight.now_ms, battery_min=recorder.battery_min)
    return {**figures, **mission_figures(flight.supervisor.mission.state)}


def mission_figures(state: MissionState) -> dict[str, Any]:
    """The summary's figures of the mission: `cost_m`, `planned_m` and `services`."""
    return {"cost_m": state.cost_m, "planned_m": state.planned_m, "services": state.services}


# Opens the flights of one aPad, or of several, in virtual time and in this process, without files.
@dataclass(frozen=True, slots=True)
class OpenedLockstep:
    """A runner that is ready to `run`, and each aPad's recorder."""

    runner: LockstepRunner
    recorders: dict[str, MemoryRecorder]

    @property
    def flights(self) -> Mapping[str, MemberFlight]:
        return self.runner.flights

    def figures(self) -> dict[str, dict[str, Any]]:
        """The figures of `uptime_figures` and of the mission, by aPad."""
        return {name: _figures(it.flight, self.recorders[name]) for name, it in self.flights.items()}


def open_lockstep(
    members: Sequence[Member],
    sharing: Sharing,
    recorder_of: Callable[[Scenario], MemoryRecorder] = MemoryRecorder,
    trust: Trust | None = None,
) -> OpenedLockstep:
    """Opens the flights of several aPads that reach each other, or the one flight of a single aPad."""
    recorders: dict[str, MemoryRecorder] = {}

    def open_member(member: Member, join: Join, sea: Sea | None) -> MemberFlight:
        flight, recorder = open_flight(
            member.scenario, join=join, recorder_of=recorder_of, sea=sea, trust=trust
        )
        recorders[member.name] = recorder
        return MemberFlight(member.scenario.apad.start_m, flight, recorder)

    return OpenedLockstep(LockstepRunner.of(members, sharing, open_member), recorders)
