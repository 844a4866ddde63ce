"""The energy of a run's aMussels by module and by state.

The firmware does the same twice, so an aMussel of a run is run again from its start and from the stimuli in the journal. A
ledger takes what its board switches. The truths that follow are compared with those that the run recorded.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from agents.fleet_config import FleetConfig
from agents.mussel.agent import Agent, AgentConfig
from agents.mussel.outputs import Output, Truth
from agents.mussel.physical import Physical
from agents.mussel.stimuli import WasReset, from_json
from agents.time_scale import TimeScale
from apad_bridge.assembly.fleet_parts import fleet_config, initial_states
from apad_bridge.assembly.flight_config import flight_config
from apad_bridge.events.fleet_events import ProcessDied, Stimulated, TruthChanged
from apad_bridge.records.journal import JournalContents, read_journal
from apad_bridge.records.run_directory import RunDirectory, RunDirectoryError
from apad_bridge.records.truth_lines import truth_of
from apad_bridge.scenario.firmware_config import codec_of
from apad_bridge.scenario.schema import Scenario
from apad_bridge.scenario.starts import starts_of
from firmware_model.actions import Action, RunBuoyancy, SetRail
from firmware_model.packets.codec import Codec
from firmware_model.power.charge import MS_PER_HOUR, ChargeModel, Flow, fraction
from firmware_model.power.energy_ledger import EnergyLedger
from firmware_model.power.rails import Rail, bits
from firmware_model.sampling.flash import Flash, MemoryFlash
from firmware_model.stimuli import ResetCause

BOARD = "board"
"""The one module of the paper's worst case, which switches none."""
MOTORS = Rail.MOTORS.name.lower()
"""Its motors, where the scenario lets a run of theirs cost charge."""


@dataclass(frozen=True, slots=True)
class AgentEnergy:
    """Energy that one aMussel drew, in fractions of a new battery; docked, a part of it came from the charger."""

    agent_id: int
    by_module: dict[str, float]
    by_state: dict[str, float]
    state_hours: dict[str, float]
    """Agent time."""
    is_exact: bool
    """The truths of the second run are the recorded ones, each of them."""


def energy_of(directory: RunDirectory, agent_ids: Sequence[int] = ()) -> list[AgentEnergy]:
    """The energy of these aMussels of a run so far, or of all.

    RunDirectoryError, one line, for a directory without a scenario that can be read, for a codec that is not installed, and
    for an id that its fleet has not.
    """
    scenario = directory.load_scenario()
    try:
        fleet, codec = fleet_config(flight_config(scenario)), codec_of(scenario)
    except ValueError as error:
        raise RunDirectoryError(f"{directory.scenario}: {error}") from error
    starts = initial_states(scenario, starts_of(scenario))
    if unknown := sorted(set(agent_ids) - starts.keys()):
        raise RunDirectoryError(
            f"{directory.path}: there is no aMussel {unknown[0]}; its fleet has {min(starts)} to {max(starts)}"
        )
    journal = read_journal(directory.journal)
    chosen = {agent_id: starts[agent_id] for agent_id in agent_ids or starts}
    return [it.agent.energy(it) for it in _run_again(fleet, codec, chosen, journal, scenario.time_scale)]


def rails_of(scenario: Scenario, journal: JournalContents) -> dict[int, list[tuple[int, int]]]:
    """The rails that each aMussel's board had on, as (agent ms, set of rails) from each switch to the next.

    Without those whose second run is not the recorded one, and empty for boards that switch no modules. ScenarioError for a
    codec that is not installed.
    """
    config = flight_config(scenario)
    if config.board.whole is None:
        return {}
    starts = initial_states(scenario, starts_of(scenario))
    again = _run_again(fleet_config(config), codec_of(scenario), starts, journal, scenario.time_scale)
    return {it.agent.config.board.agent_id: it.agent.switched for it in again if it.is_exact}


def summed(
    energies: Iterable[AgentEnergy], of: Callable[[AgentEnergy], Mapping[str, float]]
) -> dict[str, float]:
    """The sums over all aMussels by name, the greatest first."""
    sums: dict[str, float] = {}
    for energy in energies:
        for name, drawn in of(energy).items():
            sums[name] = sums.get(name, 0.0) + drawn
    return dict(sorted(sums.items(), key=lambda item: -item[1]))


class _SecondRun(NamedTuple):
    agent: _Metered
    truths: list[Truth]
    until_ms: int
    """Agent time."""
    is_exact: bool
    """Each recorded truth is one of these."""


def _run_again(
    fleet: FleetConfig,
    codec: Codec,
    starts: Mapping[int, Physical],
    journal: JournalContents,
    scale: TimeScale,
) -> Iterator[_SecondRun]:
    """Runs each aMussel with one of these starts."""
    felt: dict[int, list[Stimulated | ProcessDied]] = {agent_id: [] for agent_id in starts}
    recorded_of: dict[int, list[Truth]] = {agent_id: [] for agent_id in starts}
    for _, event in journal.entries:
        match event:
            case TruthChanged() if event.id in starts:
                recorded_of[event.id].append(truth_of(event))
            case Stimulated() | ProcessDied() if event.id in starts:
                felt[event.id].append(event)
    maker = fleet.maker()
    for agent_id, recorded in recorded_of.items():
        agent = _Metered(maker.config(agent_id), codec, starts[agent_id], MemoryFlash(fleet.flash_pages))
        until_ms = _replay(agent, felt[agent_id], recorded, scale.agent_ms(journal.last_ms))
        truths = agent.take_truths()
        yield _SecondRun(agent, truths, until_ms, _is_same_course(truths, recorded))


def _replay(
    agent: Agent, felt: Iterable[Stimulated | ProcessDied], recorded: list[Truth], until_ms: int
) -> int:
    """Returns the agent time up to which it ran."""
    for event in _as_lived(felt):
        if isinstance(event, Stimulated):
            agent.receive(from_json(event.wire), event.agent_ms)
            continue
        agent.receive(WasReset(ResetCause[event.cause]), event.agent_ms)
        if event.gave_up is not None:
            until_ms = event.agent_ms
            break
    if not recorded or recorded[-1].at_ms <= until_ms:
        agent.advance(until_ms)
    return until_ms


def _as_lived(felt: Iterable[Stimulated | ProcessDied]) -> list[Stimulated | ProcessDied]:
    """The stimuli and deaths in the order in which an agent lived them.

    A stimulus is journaled when it waits for its window. A death takes effect at the begin of the window that was not
    answered: the stimuli that waited for that one came after the boot.
    """
    lived: list[Stimulated | ProcessDied] = []
    for event in felt:
        place = len(lived)
        if isinstance(event, ProcessDied):
            while place and isinstance(before := lived[place - 1], Stimulated):
                if before.agent_ms < event.agent_ms:
                    break
                place -= 1
        lived.insert(place, event)
    return lived


class _Metered(Agent):
    """An agent whose board's actions go into a ledger."""

    def __init__(self, config: AgentConfig, codec: Codec, physical: Physical, flash: Flash) -> None:
        whole = config.board.whole
        self._ledger = None if whole is None else EnergyLedger(whole.power.loads, 0)
        self._rails = 0
        self._motors: Counter[str] = Counter()
        """Grains of motor runs, by the state that began with one."""
        self.switched: list[tuple[int, int]] = []
        """(agent ms, set of rails) after each switch."""
        super().__init__(config, codec, physical, 0, ResetCause.POWER_ON, flash)

    def _power_on(self, physical: Physical, now_ms: int, cause: ResetCause) -> list[Output]:
        if self._ledger is not None:
            self._ledger.power_off(now_ms)
            self._rails = 0
            self.switched.append((now_ms, 0))
        return super()._power_on(physical, now_ms, cause)

    def _carry_out(self, actions: list[Action]) -> list[Output]:
        if self._ledger is not None:
            self._ledger.take(actions)
            for action in actions:
                if isinstance(action, SetRail):
                    rail = bits(action.rail)
                    self._rails = self._rails | rail if action.on else self._rails & ~rail
                    self.switched.append((action.at_ms, self._rails))
        elif self.config.board.motor_run:
            for action in actions:
                if isinstance(action, RunBuoyancy):
                    self._motors[self.board.state.name] += self.config.board.motor_run
        return super()._carry_out(actions)

    def energy(self, run: _SecondRun) -> AgentEnergy:
        agent_id, charge = self.config.board.agent_id, self.config.board.charge
        if self._ledger is None:
            drawn, hours = _drawn(run, charge)
            by_module = {BOARD: fraction(drawn.total())}
            if self._motors:
                by_module[MOTORS] = fraction(self._motors.total())
            by_state = drawn + self._motors
        else:
            self._ledger.settle(run.until_ms)
            by_module = {it.name.lower(): fraction(n) for it, n in self._ledger.by_rail().items()}
            by_state = Counter({it.name: n for it, n in self._ledger.by_state().items()})
            hours = Counter({it.name: n for it, n in self._ledger.state_ms().items() if n})
        return AgentEnergy(
            agent_id,
            by_module,
            {name.lower(): fraction(n) for name, n in by_state.items()},
            {name.lower(): n / MS_PER_HOUR for name, n in hours.items()},
            run.is_exact,
        )


def _drawn(run: _SecondRun, charge: ChargeModel) -> tuple[Counter[str], Counter[str]]:
    """Grains and time by state, from truths: of the paper's worst case, which has no modules."""
    grains: Counter[str] = Counter()
    ms: Counter[str] = Counter()
    ends = [*(it.at_ms for it in run.truths[1:]), run.until_ms]
    for truth, end_ms in zip(run.truths, ends, strict=True):
        name, physical = truth.state.name, truth.physical
        for battery in (physical.primary, physical.secondary):
            if battery.flow is Flow.DISCHARGING:
                grains[name] += charge.charge_at(battery, truth.at_ms) - charge.charge_at(battery, end_ms)
        ms[name] += end_ms - truth.at_ms
    return grains, ms


def _is_same_course(truths: Iterable[Truth], recorded: list[Truth]) -> bool:
    """The journal leaves out small steps of drift, and each truth that it has is one of these."""
    found = {(it.at_ms, it.state, it.physical.primary, it.physical.secondary) for it in truths}
    return all((it.at_ms, it.state, it.physical.primary, it.physical.secondary) in found for it in recorded)
