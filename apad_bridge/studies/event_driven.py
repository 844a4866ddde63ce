"""The event-driven model of a mission: the mission itself, with the ticks between its events skipped.

The model flies the same supervisor, mission, strategies and docking port, the same boards and bodies, and the same draws
as a flight in virtual time. Three parts are computed instead of stepped:

- a status packet: the belief at a tick is made from the aMussel's newest truth, rounded as the packet rounds it;
- the random drift: a sum of the body's own steps, which all missions with the same seed share;
- the aPad's cruise: steps at constant speed and heading are one step.

A tick is skipped if nothing can happen at it: the mission itself says whether it would act, and the agents and the aPad say
when they do. A tick too many changes nothing, because a flight may be cut anywhere. `model_gap` names what is left out.
"""

from __future__ import annotations

import math
from array import array
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache, lru_cache, partial

import numpy as np
import numpy.typing as npt

from agents.hosting.in_process import InProcessHost
from agents.mussel.body import drift_words
from agents.mussel.outputs import Truth
from agents.time_scale import TICK_MS, MissionMs
from apad_bridge.assembly import fleet_parts, flight_parts
from apad_bridge.assembly.flight_config import flight_config
from apad_bridge.beliefs.belief import Belief
from apad_bridge.beliefs.hold_last import HoldLast
from apad_bridge.events.event import Event
from apad_bridge.mission.energy_exchange import EnergyExchange
from apad_bridge.mission.facts import PlacedSample
from apad_bridge.mission.sources import Allocation
from apad_bridge.planning import registry
from apad_bridge.planning.dispatch_rule import Horizon
from apad_bridge.scenario.firmware_config import charge_models
from apad_bridge.scenario.schema import DriftMode, HearingMode, Positioning, Scenario
from apad_bridge.scenario.starts import starts_of
from apad_bridge.studies.cruising_apad import CruisingAPad
from apad_bridge.studies.mission_figures import FigureMeter, Figures
from apad_bridge.supervisor.clock import AsFastAsPossible
from apad_bridge.supervisor.context import FlightContext
from apad_bridge.supervisor.loop import Flight
from apad_bridge.supervisor.run_spec import RunSpec
from apad_bridge.supervisor.supervisor import LearnedState
from apad_bridge.vehicle.commands import BatteryReported, PoseReported
from apad_bridge.world.world import World
from firmware_model.packets.wire import CHARGE_STEPS
from firmware_model.power.charge import FULL
from firmware_model.state_groups import DOCKED
from firmware_model.states import State

_NEVER_MS = 1 << 60
_REACH_M = 3.0
"""A dock that catches from so far, as in the paper's scenarios, catches whoever drifted at random."""
_DRIFT_BLOCK = 512
"""Steps that are computed at once."""


def model_gap(scenario: Scenario) -> str | None:
    """The first thing in the scenario that the event-driven model leaves out; None if it covers the scenario."""
    fleet, docking = scenario.fleet, scenario.mission.docking
    gaps = {
        "board.whole: its timers fire too often for skipped ticks": scenario.board.whole is not None,
        "hearing.mode: only `paper` reports at every tick": scenario.hearing.mode is not HearingMode.PAPER,
        "hearing.report_period_s: only 1": scenario.hearing.report_period_s * 1000 != TICK_MS,
        "hearing.codec: only the built-in one": scenario.hearing.codec != "musselbed-1",
        "hearing.positioning: only `ground_truth`": scenario.hearing.positioning
        is not Positioning.GROUND_TRUTH,
        "guards and area.fence: a monitor looks at every tick": scenario.guards is not None
        or scenario.area.fence is not None,
        f"mission.docking.catch_radius_m: below {_REACH_M:g} m the random drift decides who is caught": (
            docking.catch_radius_m < _REACH_M and fleet.drift.mode is DriftMode.PAPER
        ),
        "water": scenario.water is not None,
        "apads: several aPads": bool(scenario.apads),
        "beliefs.twin": scenario.beliefs.twin is not None,
        "fleet.drift: a current": (fleet.drift.current_file or fleet.drift.current_m_s) is not None,
        "mission.docking.camera_ids and visual_ids, which the vehicle docks": bool(
            docking.camera_ids or docking.visual_ids
        ),
        "mission.end_by: the way home begins at any tick": scenario.mission.end_by is not None,
        "mission.docking.profile: only `virtual`": docking.profile.value != "virtual",
    }
    return next((gap for gap, is_there in gaps.items() if is_there), None)


def fly_event_driven(scenario: Scenario, trust: registry.Trust | None = None) -> Figures:
    """Flies a mission that `model_gap` finds covered; returns its figures. `trust` is as of `flight_config`."""
    full_config = flight_config(scenario, trust)
    # The reports and the random drift are computed here, so the agents act at events alone.
    config = replace(
        full_config,
        reports=replace(full_config.reports, period_ms=_NEVER_MS),
        body=replace(full_config.body, drift_amplitude_um=0),
    )
    initial_states = fleet_parts.initial_states(scenario, starts_of(scenario))
    host = InProcessHost(fleet_parts.fleet_config(config), initial_states)
    fleet = fleet_parts.fleet_of(config, host, dict.fromkeys(initial_states, 0))
    vehicle = CruisingAPad(scenario.apad, flight_parts.misses(scenario), scenario.area.home_m)
    beliefs = TruthfulReports(scenario)
    learned = LearnedState(
        beliefs, flight_parts.initial_learned_state(config).ranging, Allocation(beliefs, config.ids)
    )
    recorder = EventRecorder(beliefs, FigureMeter(scenario))
    context = FlightContext(vehicle=vehicle, pace=AsFastAsPossible(), world=World(fleet))
    flight = flight_parts.flight(config, context, recorder, RunSpec(learned=learned))
    supervisor = flight.supervisor
    mission = supervisor.mission
    assert isinstance(mission, EnergyExchange), "no script flies a study"
    ticks = Ticks(scenario, flight, mission, beliefs, vehicle)
    while True:
        flight.tick(flight.now_ms)
        if supervisor.has_ended:
            break
        flight.now_ms = MissionMs(ticks.next_tick_ms(flight.now_ms, fleet.coordinator.next_due_ms))
    return recorder.meter.figures(flight.now_ms, supervisor.mission.state, vehicle.battery.ledger)


class TruthfulReports(HoldLast):
    """The beliefs of a supervisor that hears each aMussel at each tick, made from the newest truths.

    In the paper's mode of hearing each packet arrives within its tick, so the belief at a tick is the truth at that time,
    rounded as the packet rounds it.
    """

    def __init__(self, scenario: Scenario) -> None:
        super().__init__(scenario.fleet.ids, scenario.time_scale)
        self._scale = scenario.time_scale
        self.charge_of = charge_models(scenario)
        drift = scenario.fleet.drift
        amplitude_um = round(drift.amplitude_m * 1e6) if drift.mode is DriftMode.PAPER else 0
        drift_of = fleet_drift(scenario.seed, amplitude_um)
        self._drift = {agent_id: drift_of(agent_id) for agent_id in scenario.fleet.ids}
        self.truths: dict[int, Truth] = {}
        self._drifts_from = dict.fromkeys(scenario.fleet.ids, (0, 0))
        """The drift up to the first step that each aMussel took in the water."""
        self._all: list[Belief] | None = None

    def take(self, truth: Truth) -> None:
        before = self.truths.get(truth.agent_id)
        if before is not None and before.physical.docked and not truth.physical.docked:
            step = self._scale.mission_span(truth.at_ms) // TICK_MS
            self._drifts_from[truth.agent_id] = self._drift[truth.agent_id](step)
        self.truths[truth.agent_id] = truth

    def show(self, at_ms: MissionMs) -> None:
        """Makes the beliefs those of a time to come, if no aMussel acts before, or those of the present again."""
        self._now_ms, self._all = at_ms, None

    def advance(self, now_ms: MissionMs) -> None:
        if now_ms > self._now_ms:
            self._all = None
        super().advance(now_ms)

    def get(self, agent_id: int) -> Belief | None:
        self.all()
        return self._at_now.get(agent_id)

    def all(self) -> list[Belief]:
        if self._all is None:
            self._at_now = {
                agent_id: self._report(truth)
                for agent_id, truth in sorted(self.truths.items())
                if truth.state is not State.BOOTING
            }
            self._all = list(self._at_now.values())
        return self._all

    def _report(self, truth: Truth) -> Belief:
        physical, now_ms = truth.physical, self._now_ms
        charge = self.charge_of(truth.agent_id)
        agent_ms = self._scale.agent_ms(now_ms)
        north_um, east_um = physical.north_um, physical.east_um
        if not physical.docked:
            north_from, east_from = self._drifts_from[truth.agent_id]
            north_to, east_to = self._drift[truth.agent_id](now_ms // TICK_MS)
            north_um += north_to - north_from
            east_um += east_to - east_from
        return Belief(
            agent_id=truth.agent_id,
            heard_ms=now_ms,
            state=truth.state,
            primary=_as_sent(charge.charge_at(physical.primary, agent_ms)),
            secondary=_as_sent(charge.charge_at(physical.secondary, agent_ms)),
            north_m=round(north_um / 1e6 * 100) / 100,
            east_m=round(east_um / 1e6 * 100) / 100,
        )


def _as_sent(charge: int) -> float:
    return round(charge / FULL * CHARGE_STEPS) / CHARGE_STEPS


DriftSum = Callable[[int], tuple[int, int]]
"""The sum of a body's random steps 1 to n, as a function of n: (north, east) in micrometres."""


@lru_cache(maxsize=1)
def fleet_drift(seed: int, amplitude_um: int) -> Callable[[int], DriftSum]:
    """The drift of each aMussel, by id. A study's worker flies the missions of a seed one after the other, which share it.

    Ten days at theta 1 take 14 MB for each aMussel, and most of the time of a first mission. So only one seed is kept.
    """
    return cache(partial(drift_sums, seed, amplitude_um=amplitude_um))


def drift_sums(seed: int, agent_id: int, amplitude_um: int) -> DriftSum:
    """Computes the steps of one aMussel as they are asked for, and keeps the sums."""
    norths, easts = array("q", [0]), array("q", [0])

    def sum_to(n: int) -> tuple[int, int]:
        if amplitude_um == 0:
            return 0, 0
        while len(norths) <= n:
            first = len(norths)
            words = b"".join([drift_words(seed, agent_id, it) for it in range(first, first + _DRIFT_BLOCK)])
            steps = drift_steps_um(np.frombuffer(words, "<u8").reshape(-1, 2), amplitude_um).cumsum(axis=0)
            norths.frombytes((norths[-1] + steps[:, 0]).tobytes())
            easts.frombytes((easts[-1] + steps[:, 1]).tobytes())
        return norths[n], easts[n]

    return sum_to


def drift_steps_um(words: npt.NDArray[np.uint64], amplitude_um: int) -> npt.NDArray[np.int64]:
    """Scales random 64-bit words, (steps, 2), to steps of `drift_step_um`, in 32-bit halves for want of 128 bits."""
    width, half = np.uint64(2 * amplitude_um + 1), np.uint64(32)
    low = (words & np.uint64(0xFFFFFFFF)) * width >> half
    scaled: npt.NDArray[np.int64] = ((words >> half) * width + low >> half).astype(np.int64) - amplitude_um
    return scaled


class EventRecorder:
    """A flight's recorder that keeps figures alone."""

    def __init__(self, beliefs: TruthfulReports, meter: FigureMeter) -> None:
        self._beliefs = beliefs
        self.meter = meter

    def event(self, at_ms: int, event: Event) -> None:
        pass

    def truths(self, truths: list[Truth]) -> None:
        for truth in truths:
            self.meter.take(truth)
            self._beliefs.take(truth)

    def samples(self, agent_id: int, samples: Sequence[PlacedSample]) -> None:
        pass

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


class Ticks:
    """Finds the next tick at which somebody acts.

    The mission is asked for ticks to come, by the beliefs of those times: `EnergyExchange.is_due`. Between two events of
    agents and aPad it stays due once it is, because charges in the water fall and those in docks rise. So halving the span
    finds the first such tick.
    """

    def __init__(
        self,
        scenario: Scenario,
        flight: Flight,
        mission: EnergyExchange,
        beliefs: TruthfulReports,
        vehicle: CruisingAPad,
    ) -> None:
        self._end_ms = scenario.duration_ms
        self._supervisor = flight.supervisor
        self._mission = mission
        self._beliefs = beliefs
        self._vehicle = vehicle
        self._home = flight_parts.home_stays(scenario)
        home = scenario.apad.home
        self._ends_at = scenario.mission.end_at_apad_fraction
        self._least_battery = self._ends_at if home is None else max(self._ends_at, home.go_at)
        """The part of the aPad's battery at which the mission acts."""
        self._knows_end = scenario.mission.horizon is Horizon.END
        self._full_charge = _least_charge_above(scenario.mission.full_threshold)

    def next_tick_ms(self, now_ms: MissionMs, agents_due_ms: int | None) -> int:
        """The next tick after `now_ms`; `agents_due_ms` is when an agent next acts by itself."""
        soonest_ms = now_ms + TICK_MS
        events_ms = (agents_due_ms, self._vehicle_due_ms(now_ms), self._home.next_call_ms(now_ms))
        limit_ms = min(self._end_ms, *(it for it in events_ms if it is not None))
        limit_ms = max(soonest_ms, -(-limit_ms // TICK_MS) * TICK_MS)
        limit_ms = self._first_due_ms(now_ms, soonest_ms, limit_ms)
        least = self._least_battery if self._mission.leaves_home_at is None else self._ends_at
        # A mission with a known end counts its way second by second.
        passes = self._mission.moved if self._knows_end and self._mission.state.leg is not None else None
        return self._vehicle.advance_until(limit_ms, least, passes)

    def _vehicle_due_ms(self, now_ms: MissionMs) -> int | None:
        """The time by which there must be a tick for the aPad's sake, if it reports nothing before."""
        due_ms, leaves_at = self._supervisor.port.next_due_ms, self._mission.leaves_home_at
        if leaves_at is not None:
            return now_ms + self._vehicle.least_charging_ms(leaves_at)
        if due_ms is None or self._mission.state.leg is None:
            return due_ms
        return due_ms - TICK_MS  # a pose before the port's stall watch runs out restarts it

    def _first_due_ms(self, now_ms: MissionMs, soonest_ms: int, limit_ms: int) -> int:
        """The first tick from `soonest_ms` on at which the mission is due; `limit_ms` if there is none before."""
        if self._may_stop_to_charge():
            return soonest_ms
        low, high = soonest_ms // TICK_MS, limit_ms // TICK_MS
        # What an agent does at the limit is not known before, so that tick comes in any case.
        if low == high or not self._is_due(MissionMs((high - 1) * TICK_MS)):
            low = high
        while low < high:
            middle = (low + high) // 2
            low, high = (low, middle) if self._is_due(MissionMs(middle * TICK_MS)) else (middle + 1, high)
        self._beliefs.show(now_ms)
        return low * TICK_MS

    def _is_due(self, at_ms: MissionMs) -> bool:
        self._beliefs.show(at_ms)
        return self._mission.is_due(at_ms)

    def _may_stop_to_charge(self) -> bool:
        """A docked aMussel does not get full by what its charger does now: the watch for stalls must see each tick."""
        for agent_id in self._mission.watched:
            if (belief := self._beliefs.get(agent_id)) is None or belief.state not in DOCKED:
                return True
            physical = self._beliefs.truths[agent_id].physical
            if self._beliefs.charge_of(agent_id).reaches_at_ms(physical.primary, self._full_charge) is None:
                return True
        return False


def _least_charge_above(threshold: float) -> int:
    """A charge in grains that a packet rounds to more than `threshold`, or a full one."""
    return min(FULL, math.ceil((math.floor(threshold * CHARGE_STEPS) + 1.5) / CHARGE_STEPS * FULL))
