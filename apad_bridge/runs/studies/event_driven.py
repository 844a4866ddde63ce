"""The event-driven model of a mission: the mission itself, with the ticks between its events skipped.

The model flies the same supervisor, mission, strategies and docking port, the same boards and bodies, and the same draws
as a flight in virtual time. Three parts are computed instead of stepped:

- a status packet: the belief at a tick is made from the aMussel's newest truth, rounded as the packet rounds it;
- the random drift: a sum of the body's own steps, which all missions with the same seed share;
- the aPad's cruise: steps at constant speed and heading are one step.

A tick is skipped if nothing can happen at it: `Ticks.next_tick_ms` is never later than the first tick at which the mission
would act. A tick too many changes nothing, because a flight may be cut anywhere. `model_gap` names what is left out.
"""

from __future__ import annotations

import math
from array import array
from collections.abc import Callable, Collection, Sequence
from dataclasses import replace
from functools import cache, lru_cache, partial

import numpy as np
import numpy.typing as npt

from agents.hosting.in_process import InProcessHost
from agents.mussel.body import drift_words
from agents.mussel.outputs import Truth
from agents.time_scale import MissionMs
from apad_bridge.assembly import fleet_parts, parts
from apad_bridge.assembly.flight_config import flight_config
from apad_bridge.beliefs.belief import Belief
from apad_bridge.beliefs.hold_last import HoldLast
from apad_bridge.events.event import Event
from apad_bridge.events.mission import Phase, StepGivenUp
from apad_bridge.mission.events import PlacedSample
from apad_bridge.mission.sources import Allocation
from apad_bridge.mission.state import MissionState
from apad_bridge.planning import registry
from apad_bridge.planning.paper_strategies import NoCollection
from apad_bridge.runs.studies.cruising_apad import CruisingAPad
from apad_bridge.runs.studies.figures import FigureMeter, Figures
from apad_bridge.scenario.firmware_config import charge_models
from apad_bridge.scenario.schema import (
    Dispatch,
    DriftMode,
    HearingMode,
    Horizon,
    Positioning,
    Scenario,
)
from apad_bridge.scenario.starts import starts_of
from apad_bridge.supervisor.clock import AsFastAsPossible
from apad_bridge.supervisor.context import FlightContext
from apad_bridge.supervisor.core import TICK_MS, LearnedState
from apad_bridge.supervisor.loop import Flight
from apad_bridge.vehicle.commands import BatteryReported, PoseReported
from firmware_model.packets.wire import CHARGE_STEPS
from firmware_model.power.charge import FULL, ChargeModel
from firmware_model.state_groups import BEYOND_HELP, DOCKED, UP_AND_UNDOCKED
from firmware_model.states import State

_NEVER_MS = 1 << 60
_REACH_M = 3.0
"""A dock that catches from so far, as in the paper's scenarios, catches whoever drifted at random."""
_DRIFT_BLOCK = 512
"""Steps that are computed at once."""
_SURFACING_OR_UP = (State.SURFACING, State.FLOATING)


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


def fly_event_driven(scenario: Scenario) -> Figures:
    """Flies a mission that `model_gap` finds covered; returns its figures."""
    full_config = flight_config(scenario)
    # The reports and the random drift are computed here, so the agents act at events alone.
    config = replace(
        full_config,
        reports=replace(full_config.reports, period_ms=_NEVER_MS),
        body=replace(full_config.body, drift_amplitude_um=0),
    )
    starts = starts_of(scenario)
    initial_states = fleet_parts.initial_states(scenario, starts)
    host = InProcessHost(fleet_parts.fleet_config(config), initial_states)
    fleet = fleet_parts.fleet_of(config, host, dict.fromkeys(initial_states, 0))
    vehicle = CruisingAPad(scenario.apad, parts.misses(scenario), scenario.area.home_m)
    beliefs = TruthfulReports(scenario)
    learned = LearnedState(
        beliefs, parts.initial_learned_state(config).ranging, Allocation(beliefs, config.ids)
    )
    supervisor = parts.supervisor(config, learned=learned)
    recorder = EventRecorder(beliefs, FigureMeter(scenario))
    context = FlightContext(vehicle=vehicle, pace=AsFastAsPossible(), fleet=fleet)
    flight = Flight(supervisor, context, recorder)
    ticks = Ticks(scenario, flight, beliefs, vehicle, recorder)
    while True:
        flight.tick(flight.now_ms)
        if supervisor.has_ended:
            break
        flight.now_ms = MissionMs(ticks.next_tick_ms(flight.now_ms, fleet.coordinator.next_due_ms))
    return recorder.meter.figures(flight.now_ms, supervisor.mission.state, vehicle.ledger)


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
        self._drifts_from: dict[int, int] = dict.fromkeys(scenario.fleet.ids, 0)
        """The drift step before the first one that each aMussel took in the water."""
        self._all: list[Belief] | None = None

    def take(self, truth: Truth) -> None:
        before = self.truths.get(truth.agent_id)
        if before is not None and before.physical.docked and not truth.physical.docked:
            self._drifts_from[truth.agent_id] = self._scale.mission_span(truth.at_ms) // TICK_MS
        self.truths[truth.agent_id] = truth

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
            drift = self._drift[truth.agent_id]
            north_from, east_from = drift(self._drifts_from[truth.agent_id])
            north_to, east_to = drift(now_ms // TICK_MS)
            north_um += north_to - north_from
            east_um += east_to - east_from
        return Belief(
            truth.agent_id,
            now_ms,
            truth.state,
            _as_sent(charge.charge_at(physical.primary, agent_ms)),
            _as_sent(charge.charge_at(physical.secondary, agent_ms)),
            round(north_um / 1e6 * 100) / 100,
            round(east_um / 1e6 * 100) / 100,
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
        self.given_up_ms: dict[int, int] = {}
        """The time at which the mission last gave up a step of each aMussel."""

    def event(self, at_ms: int, event: Event) -> None:
        if isinstance(event, StepGivenUp):
            self.given_up_ms[event.agent] = at_ms

    def truths(self, truths: list[Truth]) -> None:
        for truth in truths:
            self.meter.take(truth)
            self._beliefs.take(truth)

    def samples(self, agent_id: int, samples: Sequence[PlacedSample]) -> None:
        pass

    def tick(
        self,
        now_ms: int,
        beliefs: list[Belief],
        pose: PoseReported | None,
        battery: BatteryReported | None,
        primitive: str,
        docks: tuple[int | None, ...],
    ) -> None:
        pass


class Ticks:
    """Finds the next tick at which the mission may act."""

    def __init__(
        self,
        scenario: Scenario,
        flight: Flight,
        beliefs: TruthfulReports,
        vehicle: CruisingAPad,
        recorder: EventRecorder,
    ) -> None:
        self._config = scenario.mission
        self._tick_agent_ms = scenario.time_scale.agent_span(TICK_MS)
        self._count = len(scenario.fleet.ids)
        self._end_ms = -(-round(scenario.duration_s * 1000) // TICK_MS) * TICK_MS
        self._supervisor = flight.supervisor
        self._beliefs = beliefs
        self._vehicle = vehicle
        self._recorder = recorder
        self._low_charge = _highest_charge_at_most(scenario.mission.pool_threshold)
        again = scenario.mission.again_threshold
        self._again_charge = None if again is None else _highest_charge_at_most(again)
        self._collects = not isinstance(registry.collection(scenario.mission.collection), NoCollection)
        self._home = parts.home_stays(scenario)
        home = scenario.apad.home
        goes_home_at, self._leaves_home_at = (0.0, 0.0) if home is None else (home.go_at, home.leave_at)
        self._ends_at = scenario.mission.end_at_apad_fraction
        self._least_battery = max(self._ends_at, goes_home_at)
        """The part of the aPad's battery at which the mission acts."""
        self._is_asynchronous = scenario.mission.dispatch is Dispatch.ASYNCHRONOUS
        self._has_fixed_thresholds = scenario.mission.horizon is Horizon.OPEN
        self._releases_at = [_highest_charge_at_most(scenario.mission.full_threshold) + 1]
        """The charges in grains at which a docked aMussel may leave, the highest last."""
        if scenario.mission.charge_to is not None:
            self._releases_at.insert(0, _highest_charge_at_most(scenario.mission.charge_to) + 1)

    def next_tick_ms(self, now_ms: int, agents_due_ms: int | None) -> int:
        """The next tick after `now_ms`; `agents_due_ms` is when an agent next acts by itself."""
        soonest_ms = now_ms + TICK_MS
        limit_ms = min(self._end_ms, self._limit_ms(now_ms, agents_due_ms))
        limit_ms = max(soonest_ms, -(-limit_ms // TICK_MS) * TICK_MS)
        home_ms = self._home.next_call_ms(now_ms)
        limit_ms = limit_ms if home_ms is None else max(soonest_ms, min(limit_ms, home_ms))
        is_home = self._supervisor.mission.state.phase is Phase.AT_HOME
        return self._vehicle.advance_until(limit_ms, self._ends_at if is_home else self._least_battery)

    def _limit_ms(self, now_ms: int, agents_due_ms: int | None) -> int:
        """The time by which there must be a tick, if the vehicle reports nothing before."""
        state, port = self._supervisor.mission.state, self._supervisor.port
        beliefs = self._beliefs.all()
        held = dict(state.docked).values()
        planned = {step.agent_id for step in state.plan.steps}
        is_settled = len(beliefs) == self._count and not any(
            it.state in UP_AND_UNDOCKED and it.agent_id not in planned and it.agent_id not in held
            for it in beliefs
        )
        battery = self._supervisor.battery
        is_called_home = self._home.must_go(now_ms, None if battery is None else battery.fraction)
        if not is_settled or (is_called_home and state.phase is not Phase.AT_HOME):
            return now_ms
        port_due_ms = _NEVER_MS if port.next_due_ms is None else port.next_due_ms
        due_ms = _NEVER_MS if agents_due_ms is None else agents_due_ms
        due_ms = min(due_ms, self._next_in_pool_again_ms(now_ms))
        if not self._has_fixed_thresholds and state.phase in (Phase.IDLE, Phase.CHARGE):
            return now_ms
        match state.phase:
            case Phase.IDLE:
                if not self._collects:
                    return due_ms
                return min(due_ms, self._enough_in_pool_ms(beliefs, self._config.batch, now_ms))
            case Phase.GO_COLLECT:
                # A pose before the port's stall watch runs out restarts it.
                return min(due_ms, port_due_ms - TICK_MS, self._next_permission_ms(state, now_ms))
            case Phase.AWAIT_SURFACING:
                belief = self._beliefs.get(state.plan.steps[0].agent_id)
                if belief is None or belief.state is State.FLOATING:
                    return now_ms
                gives_up_ms = state.since_ms + round(self._config.silence_timeout_s * 1000) + TICK_MS
                if gives_up_ms <= now_ms:
                    return now_ms
                return min(due_ms, port_due_ms, gives_up_ms, self._next_permission_ms(state, now_ms))
            case Phase.GO_DEPLOY:
                return port_due_ms - TICK_MS
            case Phase.DOCK | Phase.UNDOCK:
                return port_due_ms
            case Phase.CHARGE:
                return self._next_release_ms(beliefs, held, now_ms)
            case Phase.AT_HOME:
                return min(due_ms, now_ms + self._vehicle.least_charging_ms(self._leaves_home_at))
            case _:
                return now_ms

    def _next_permission_ms(self, state: MissionState, now_ms: int) -> int:
        """The next time at which the aMussel of the step under way may be permitted again to surface, or be given up."""
        belief = self._beliefs.get(state.plan.steps[0].agent_id)
        if belief is None:
            return now_ms
        if belief.state in _SURFACING_OR_UP:
            return _NEVER_MS
        repeat_ms = max(1, round(self._config.permission_repeat_s * 1000))
        return state.since_ms + ((now_ms - state.since_ms) // repeat_ms + 1) * repeat_ms

    def _next_in_pool_again_ms(self, now_ms: int) -> int:
        """The end of the next exclusion: for a while the pool leaves out an aMussel whose step was given up."""
        ends_ms = (
            it + round(self._config.silence_timeout_s * 1000) for it in self._recorder.given_up_ms.values()
        )
        return min((it for it in ends_ms if it > now_ms), default=_NEVER_MS)

    def _enough_in_pool_ms(self, beliefs: Sequence[Belief], batch: int, now_ms: int) -> int:
        """The mission time by which a batch may have gathered: the charges fall to the threshold one by one."""
        alive = [it for it in beliefs if it.state not in BEYOND_HELP]
        tries = dict(self._supervisor.mission.state.failed_tries).values()
        if max(tries, default=0) >= self._config.collection_attempts:
            return now_ms  # an aMussel that is left alone makes the batch smaller
        batch = 1 if self._is_asynchronous else min(batch, max(1, len(alive)))
        low_at_ms, again_at_ms = [], []
        served = frozenset() if self._again_charge is None else self._supervisor.mission.state.served
        for belief in alive:
            physical = self._beliefs.truths[belief.agent_id].physical
            if belief.state is State.FLOATING and belief.primary <= 0:
                return now_ms
            if belief.state in DOCKED:
                continue
            charge = self._charge_model(belief)
            falls_ms = charge.falls_to_at_ms(physical.primary, self._low_charge)
            if falls_ms is not None:
                low_at_ms.append((falls_ms // self._tick_agent_ms * TICK_MS, belief.agent_id in served))
            if self._again_charge is not None:
                falls_ms = charge.falls_to_at_ms(physical.primary, self._again_charge)
                again_at_ms += [] if falls_ms is None else [falls_ms // self._tick_agent_ms * TICK_MS]
        first_again_ms = min(again_at_ms, default=_NEVER_MS)
        in_pool_ms = sorted(max(at_ms, first_again_ms) if again else at_ms for at_ms, again in low_at_ms)
        return in_pool_ms[batch - 1] if len(in_pool_ms) >= batch else _NEVER_MS

    def _next_release_ms(self, beliefs: Sequence[Belief], held: Collection[int], now_ms: int) -> int:
        """The mission time by which a docked aMussel may leave, one may be collected beside those, or a watch for stalls
        must see them."""
        docked = [self._beliefs.get(agent_id) for agent_id in held]
        times_ms = [self._reach_at_ms(held, charge) for charge in self._releases_at]
        if not held or any(it is None or it.state not in DOCKED for it in docked) or _NEVER_MS in times_ms:
            return now_ms
        soonest_ms = next((it for it in times_ms if it > now_ms), now_ms)
        makes_room = self._config.charge_to is not None and times_ms[0] <= now_ms
        has_room = self._is_asynchronous and len(held) < self._supervisor.mission.state.dock_count
        lead = self._config.charge_lead
        if not makes_room and not has_room and lead is None:
            return soonest_ms
        enough_ms = self._enough_in_pool_ms(beliefs, self._config.batch, now_ms)
        if not makes_room and not has_room and lead is not None:
            enough_ms = max(enough_ms, self._lead_at_ms(beliefs, held, lead))
        return min(soonest_ms, enough_ms)

    def _lead_at_ms(self, beliefs: Sequence[Belief], held: Collection[int], lead: float) -> int:
        """The mission time by which the docked aMussels may lead a batch of those in the water.

        Who waits falls to a level of charge the later, the lower it is; the docked ones then lead that level the sooner. So
        the time is where both meet.
        """
        waiting = [it for it in beliefs if it.state not in DOCKED and it.state not in BEYOND_HELP]
        batch = min(1 if self._is_asynchronous else self._config.batch, len(waiting))
        if not batch:
            return _NEVER_MS

        def falls_at_ms(level: int) -> int:
            charge, found_ms = _highest_charge_at_most(level / CHARGE_STEPS), []
            for belief in waiting:
                physical = self._beliefs.truths[belief.agent_id].physical
                falls_ms = self._charge_model(belief).falls_to_at_ms(physical.primary, charge)
                found_ms.append(_NEVER_MS if falls_ms is None else falls_ms // self._tick_agent_ms * TICK_MS)
            return sorted(found_ms)[batch - 1]

        def leads_at_ms(level: int) -> int:
            led = math.floor(level + lead * CHARGE_STEPS) - 1
            while led / CHARGE_STEPS < level / CHARGE_STEPS + lead:
                led += 1
            return self._reach_at_ms(held, _highest_charge_at_most((led - 1) / CHARGE_STEPS) + 1)

        low, high = 0, CHARGE_STEPS
        while low < high:
            middle = (low + high) // 2
            low, high = (middle + 1, high) if falls_at_ms(middle) > leads_at_ms(middle) else (low, middle)
        return min(leads_at_ms(low), falls_at_ms(max(0, low - 1)))

    def _reach_at_ms(self, held: Collection[int], charge: int) -> int:
        """The mission time at which the docked ones have a charge, in grains: one by one the first of them, else all."""
        found_ms = []
        for agent_id in held:
            physical = self._beliefs.truths[agent_id].physical
            reaches_ms = self._beliefs.charge_of(agent_id).reaches_at_ms(physical.primary, charge)
            if reaches_ms is None:
                return _NEVER_MS
            found_ms.append(reaches_ms // self._tick_agent_ms * TICK_MS)
        return (min if self._is_asynchronous else max)(found_ms)

    def _charge_model(self, belief: Belief) -> ChargeModel:
        return self._beliefs.charge_of(belief.agent_id)


def _highest_charge_at_most(threshold: float) -> int:
    """The highest charge in grains that a packet rounds to `threshold` or less, up to the rounding of a tie."""
    level = math.floor(threshold * CHARGE_STEPS)
    while level / CHARGE_STEPS > threshold:
        level -= 1
    while (level + 1) / CHARGE_STEPS <= threshold:
        level += 1
    return min(FULL, (2 * level + 1) * FULL // (2 * CHARGE_STEPS))
