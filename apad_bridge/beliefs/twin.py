"""The twin: an estimator that runs the firmware's own rules forward and corrects them with packets.

Prediction follows the commands and the aPad's own actions (permission, docking, release); there is more than one
hypothesis only where an aMussel may have chosen for itself. A packet states its mode, so a packet in time corrects a single
Kalman filter. The mixture is weighed only after silence, or when a packet contradicts the expectation.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from agents.time_scale import MissionMs
from apad_bridge.beliefs import charge_filter as charge
from apad_bridge.beliefs import clock_filter as clocks
from apad_bridge.beliefs.belief import Belief, ClockBelief, Source, Suspicion
from apad_bridge.beliefs.charge_checker import ChargeChecker, Stated, extended
from apad_bridge.beliefs.charge_filter import Anchor
from apad_bridge.beliefs.measurement import (
    ClockSet,
    Docked,
    Fixed,
    HandedOver,
    Measurement,
    Permitted,
    Ranged,
    Rejected,
    Released,
    TimeslotSilent,
)
from apad_bridge.beliefs.modes import DOCKED, LIKELY, SUBMERGED, Mode
from apad_bridge.beliefs.packet_weighing import HypothesisWeigher, Reading, anchored, bounded
from apad_bridge.beliefs.place_filter import Place
from apad_bridge.beliefs.spent_charge import Load
from apad_bridge.beliefs.twin_belief import belief_from_state
from apad_bridge.beliefs.twin_parameters import UNKNOWN, Schedule, TwinParameters
from apad_bridge.beliefs.twin_state import (
    HEARD_WITHIN_MS,
    Pending,
    TwinState,
    advanced,
    charge_now,
    load_of_all,
    load_when_spent,
    obey_probability,
    released,
    shifted_to_clock,
    spent_hypotheses,
    surfaced_hypotheses,
    way_variance,
)
from apad_bridge.beliefs.twin_state_data import state_from_data, state_to_data
from firmware_model.packets import NOTHING_REPORTED, ShortStatus, StatusPacket
from firmware_model.power.charge import MS_PER_MIN
from firmware_model.states import State

ANOTHER_CHARGE = 0.3
"""Deviation of the charge of a board that replaced another and was not heard: as of any charge from 0 to 1."""
ANOTHER_PLACE_M = 100.0
"""Deviation of its place along either axis."""
_NO_PACKET = (-1, -1)
"""The newest packet of a board that was not heard."""
_CLOCK_APART_MS = 600_000
"""The least agent time between two readings of a clock."""
_FIX_APART_MS = 10_000
"""The least mission time between two fixes from packets."""
_STAGGER_MS = 7_919
_NEVER_SET_DEVIATIONS = 5.0
"""The limit of a first reading in deviations; a clock farther off was never set to nominal time."""
_DOCK_VARIANCE_M2 = 1.0
_JUMP = 0.1
"""A reading that no hypothesis explains, and that lies so far from the belief, makes its aMussel suspect."""
_SURELY = 3.0
"""A drain that was learned is surely no less than its estimate, less so many deviations."""
_WAKE_STATES = (State.ACTIVE, State.PROCESSING)
"""Parts of a short wake, a minute each; a packet in the aMussel's timeslot comes after them."""


def _within_a_wake(reading: Reading, schedule: Schedule, agent_ms: int) -> Reading:
    """A board that is awake while it should sleep is in a short wake, or listens before it sleeps: it counts as asleep."""
    if reading.state in _WAKE_STATES and schedule.at(agent_ms) is Mode.ASLEEP:
        return reading._replace(mode=Mode.ASLEEP)
    return reading


def _is_at_surface(packet: StatusPacket) -> bool:
    return packet.depth_m <= 0


def _in_another_place(twin_state: TwinState) -> TwinState:
    """In a dock now, or in the water: its readings are not compared with those from before, but for one that stands."""
    standing = twin_state.standing
    return replace(
        twin_state, track=None, standing=None if standing is None else standing._replace(since=None)
    )


class Twin:
    """An `Estimator`. `schedules` are the commanded ones, by agent id; an aMussel without one follows its usual habits."""

    def __init__(self, parameters: TwinParameters, schedules: Mapping[int, Schedule]) -> None:
        self.parameters = parameters
        self._schedules = schedules
        self._weigher = HypothesisWeigher(parameters)
        untold = parameters.untold
        self._checkers = (
            None
            if untold is None
            else (
                ChargeChecker(parameters, untold),
                ChargeChecker(parameters, untold, bias=charge.ANY_BIAS),
            )
        )
        """The checkers of any board, and of a suspect; None where a twin learns nothing: then every packet is believed."""

    def predict(self, belief: Belief, to_ms: MissionMs) -> Belief:
        if to_ms < belief.at_ms:
            raise ValueError(f"time went back: {to_ms} before {belief.at_ms}")
        return self._to_belief(belief, self._propagated(belief, to_ms), to_ms, belief.learned_from)

    def update(self, belief: Belief | None, measurement: Measurement, at_ms: MissionMs) -> Belief | None:
        if isinstance(measurement, StatusPacket):
            return self._packet_received(belief, measurement, at_ms)
        if belief is None:
            return None
        at_ms = MissionMs(max(at_ms, belief.at_ms))
        if isinstance(measurement, ShortStatus):
            return self._short_status_received(belief, measurement, at_ms)
        twin_state = self._propagated(belief, at_ms)
        match measurement:
            case TimeslotSilent():
                silent = replace(belief, silent_timeslots=belief.silent_timeslots + 1)
                return self._to_belief(silent, twin_state, at_ms, belief.learned_from | Source.SILENCE)
            case Permitted():
                twin_state = self._permitted(twin_state)
                return self._to_belief(belief, twin_state, at_ms, belief.learned_from)
            case ClockSet(agent_ms):
                clock, nominal_ms = self._clock_set(agent_ms, at_ms), self.parameters.scale.agent_ms(at_ms)
                twin_state = replace(shifted_to_clock(twin_state, agent_ms), clock=clock, clock_ms=nominal_ms)
                return self._to_belief(belief, twin_state, at_ms, belief.learned_from)
            case HandedOver(placed):
                return self._handed_over(belief, twin_state, placed, at_ms)
            case Docked():
                return self._to_belief(
                    belief, self._docked(twin_state), at_ms, belief.learned_from | Source.DOCKING
                )
            case Released(north_m, east_m):
                twin_state = self._released(twin_state, belief.agent_id)
                variance_m2 = _DOCK_VARIANCE_M2 + self.parameters.water.way_down_variance_m2
                place = Place.at(north_m, east_m, variance_m2, self.parameters.water)
                twin_state = replace(twin_state, place=place, place_ms=at_ms)
                return self._to_belief(belief, twin_state, at_ms, belief.learned_from | Source.RELEASE)
            case Fixed(north_m, east_m, variance_m2):
                place = self._place(twin_state, at_ms).corrected_by_fix(
                    north_m, east_m, variance_m2, self.parameters.water
                )
            case Ranged(range_m, north_m, east_m, variance_m2):
                place = self._place(twin_state, at_ms).corrected_by_range(
                    range_m, north_m, east_m, variance_m2
                )
        twin_state = replace(twin_state, place=place, place_ms=at_ms)
        return self._to_belief(belief, twin_state, at_ms, belief.learned_from | Source.RANGE)

    def kept(self, belief: Belief) -> dict[str, Any]:
        twin_state = belief.estimator_state
        assert isinstance(twin_state, TwinState), "a belief of another estimator"
        return {
            "heard_ms": belief.heard_ms,
            "state": int(belief.state),
            "at_ms": belief.at_ms,
            "learned_from": int(belief.learned_from),
            "silent_slots": belief.silent_timeslots,
            "memory": state_to_data(twin_state),
        }

    def restored(self, agent_id: int, data: dict[str, Any]) -> Belief:
        return belief_from_state(
            twin_state=state_from_data(data["memory"]),
            parameters=self.parameters,
            agent_id=agent_id,
            heard_ms=data["heard_ms"],
            state=State(data["state"]),
            at_ms=data["at_ms"],
            learned_from=Source(data["learned_from"]),
            silent_timeslots=data["silent_slots"],
        )

    # Time.

    def _schedule(self, agent_id: int) -> Schedule:
        return self._schedules.get(agent_id, UNKNOWN)

    def _agent_ms(self, twin_state: TwinState, at_ms: MissionMs) -> int:
        """The time on the aMussel's own clock at mission time `at_ms`, as estimated."""
        return self.parameters.scale.agent_ms(at_ms) + round(twin_state.clock.offset_ms)

    def _propagated(self, belief: Belief, to_ms: MissionMs) -> TwinState:
        twin_state = belief.estimator_state
        assert isinstance(twin_state, TwinState), "a belief of another estimator"
        schedule = self._schedule(belief.agent_id)
        return advanced(twin_state, self.parameters, schedule, self._agent_ms(twin_state, to_ms))

    def _place(self, twin_state: TwinState, at_ms: int) -> Place:
        afloat = twin_state.situation in (Mode.SURFACING, Mode.FLOATING)
        return twin_state.place.propagated(
            self.parameters.water, (at_ms - twin_state.place_ms) / 1000, afloat
        )

    def _to_belief(self, belief: Belief, twin_state: TwinState, at_ms: int, learned_from: Source) -> Belief:
        return belief_from_state(
            twin_state=twin_state,
            parameters=self.parameters,
            agent_id=belief.agent_id,
            heard_ms=belief.heard_ms,
            state=belief.state,
            at_ms=at_ms,
            learned_from=learned_from,
            silent_timeslots=belief.silent_timeslots,
        )

    # Actions of the aPad.

    def _permitted(self, twin_state: TwinState) -> TwinState:
        """Most probably the aMussel surfaces. A repeated permission counts if it is most probably still submerged."""
        if twin_state.situation is not None:
            obeyed = obey_probability(twin_state, self.parameters, twin_state.at_ms)
            if twin_state.unobeyed is None or obeyed >= LIKELY:
                return twin_state
            earlier = (load_when_spent(twin_state), twin_state.at_ms, obeyed)
            twin_state = replace(
                twin_state, load=twin_state.unobeyed[0], unobeyed=None, earlier=earlier, pending=None
            )
        drain, at_ms, load = self.parameters.drain, twin_state.at_ms, load_of_all(twin_state, self.parameters)
        runs_ms = self.parameters.scale.agent_span(HEARD_WITHIN_MS) + self.parameters.motor_run_ms
        return replace(
            twin_state,
            load=load,
            situation=Mode.SURFACING,
            since_ms=at_ms,
            unobeyed=(load, at_ms),
            pending=Pending(
                at_ms, at_ms + runs_ms, drain.motor_run, way_variance(self.parameters), Mode.SURFACING
            ),
        )

    def _docked(self, twin_state: TwinState) -> TwinState:
        if twin_state.situation is Mode.CHARGING_PRIMARY:
            return twin_state
        if twin_state.suspicion is not None:
            twin_state = replace(twin_state, suspicion=twin_state.suspicion._replace(was_docked=True))
        return anchored(_in_another_place(twin_state), self._bounded_now(twin_state), Mode.CHARGING_PRIMARY)

    def _released(self, twin_state: TwinState, agent_id: int) -> TwinState:
        twin_state = anchored(_in_another_place(twin_state), self._bounded_now(twin_state), None)
        return released(twin_state, self.parameters, self._schedule(agent_id))

    def _bounded_now(self, twin_state: TwinState) -> tuple[Anchor, ...]:
        """The present charge in [0, 1], as a few hypotheses, because a low charge stays far behind in a dock."""
        rows = charge_now(twin_state, self.parameters, surfaced_hypotheses(twin_state, self.parameters))
        return charge.reduced([bounded(row, after_measuring=False) for row in rows])

    def _handed_over(self, belief: Belief, twin_state: TwinState, placed: bool, at_ms: MissionMs) -> Belief:
        """Keeps the believed charges and place. Those of a board that was not placed get wide deviations."""
        parameters = self.parameters
        believed = self._to_belief(belief, twin_state, at_ms, belief.learned_from)
        mean, cov = charge.prior_state(parameters)
        both = [charge.PRIMARY, charge.SECONDARY]
        mean[both] = believed.primary, believed.secondary
        place, learned_from = self._place(twin_state, at_ms), Source.PACKET
        if placed:
            primary, between, secondary = believed.charge_cov
            cov[np.ix_(both, both)] = [[primary, between], [between, secondary]]
        else:
            cov[both, both] = ANOTHER_CHARGE**2
            place = Place.at(believed.north_m, believed.east_m, ANOTHER_PLACE_M**2, parameters.water)
            learned_from |= Source.HAND_OVER
        nominal_ms, usual = parameters.scale.agent_ms(at_ms), parameters.clock
        twin_state = TwinState(
            at_ms=nominal_ms,
            anchors=(Anchor(1.0, mean, cov),),
            anchor_ms=nominal_ms,
            load=Load.known(Mode.IDLE),
            situation=None,
            since_ms=nominal_ms,
            place=place,
            place_ms=at_ms,
            clock=clocks.prior_clock(usual.offset_ms, usual.drift_ppm),
            clock_ms=nominal_ms,
            packet=_NO_PACKET,
            reported=NOTHING_REPORTED,
        )
        return self._to_belief(belief, twin_state, at_ms, learned_from)

    # Packets.

    def _packet_received(self, belief: Belief | None, packet: StatusPacket, at_ms: MissionMs) -> Belief:
        reading = Reading.stated(packet.state, packet.primary, packet.secondary)
        schedule = self._schedule(packet.agent_id)
        if schedule.cycle is not None:
            reading = _within_a_wake(reading, schedule, packet.agent_ms)
        if belief is None:
            return self._first_belief(packet, reading, at_ms)
        twin_state = belief.estimator_state
        assert isinstance(twin_state, TwinState), "a belief of another estimator"
        if twin_state.packet == _NO_PACKET:
            return self._first_belief(packet, reading, MissionMs(max(at_ms, belief.at_ms)))
        if (packet.sequence, packet.agent_ms) == twin_state.packet:
            raise Rejected("a status that came already")
        if packet.agent_ms < twin_state.packet[1]:
            raise Rejected("a status that a newer one overtook")
        at_ms = MissionMs(max(at_ms, belief.at_ms))
        twin_state = replace(
            self._propagated(belief, at_ms),
            packet=(packet.sequence, packet.agent_ms),
            reported=twin_state.reported.after(packet),
        )
        is_independent = self._is_independent(twin_state, belief.agent_id, reading.mode)
        if is_independent or not self.parameters.water.is_ground_truth:
            # A fix has an error of its own, however near the last reading of the charge is.
            twin_state = self._fixed(twin_state, packet, at_ms)
        if is_independent:
            if twin_state.at_ms - twin_state.clock_ms >= _CLOCK_APART_MS:
                twin_state = self._read_clock(twin_state, packet, at_ms)
            twin_state = self._weighed(twin_state, schedule, reading)
        return self._belief_after_status(belief, twin_state, reading, at_ms)

    def _short_status_received(self, belief: Belief, packet: ShortStatus, at_ms: MissionMs) -> Belief:
        """Takes a short status: place and time stay as believed, because it has neither.

        An answer to a request may fall into a short wake of a sleeping aMussel, which still counts as asleep.
        """
        twin_state = self._propagated(belief, at_ms)
        schedule = self._schedule(belief.agent_id)
        reading = Reading.stated(packet.state, packet.primary, packet.secondary)
        reading = _within_a_wake(reading, schedule, self._agent_ms(twin_state, at_ms))
        if self._is_independent(twin_state, belief.agent_id, reading.mode):
            twin_state = self._weighed(twin_state, schedule, reading)
        return self._belief_after_status(belief, twin_state, reading, at_ms)

    def _weighed(self, twin_state: TwinState, schedule: Schedule, reading: Reading) -> TwinState:
        """Weighs a reading, or doubts its aMussel from now on if no board of its kind can state it."""
        if self._checkers is None:
            return self._weigher.weigh(twin_state, schedule, reading)
        suspicion, (checker, of_suspects) = twin_state.suspicion, self._checkers
        stood = suspicion is not None and suspicion.stands is not None
        judge = checker if suspicion is None or stood else of_suspects
        charge_stated = self.parameters.sensor.primary_of(reading.state, reading.primary)
        stated = Stated(twin_state.at_ms, charge_stated, reading.mode in DOCKED)
        if suspicion is not None and suspicion.stands is not None:
            if checker.agree(reading.primary, suspicion.stands):
                return self._weigher.unread(twin_state, schedule, reading)
            # It moves: the rest is judged as of any board, against the readings from before and what physics made of it.
            twin_state = replace(twin_state, suspicion=None)
        drain, variance = twin_state.mean[charge.DRAIN], twin_state.cov[charge.DRAIN, charge.DRAIN]
        least = float(drain) - _SURELY * math.sqrt(variance)
        standing = checker.standing(twin_state.standing, stated, reading.primary, reading.state, least)
        # A suspect whose sensor may be off by any amount stands rightly at a full battery, and at the ends of its scale.
        may_stand = suspicion is None or (not stated.docked and 0 < reading.primary < 1)
        reason = judge.judge(twin_state.track, stated, reading.state)
        track = extended(None if reason else twin_state.track, stated)
        before, twin_state = twin_state, replace(twin_state, track=track, standing=standing)
        if reason is None and not (may_stand and checker.stands(standing)):
            if suspicion is not None and standing.from_ms < stated.at_ms:
                return self._weigher.unread(twin_state, schedule, reading)  # it repeats itself, and may stand
            weighed = self._weigher.weigh(twin_state, schedule, reading, may_rest=not stood)
            if weighed.gated == twin_state.gated:
                return weighed
            away = stated.charge - self._charge_expected(twin_state)
            if abs(away) < max(_JUMP, judge.margin):
                return weighed
            reason = f"its charge jumps: {stated.charge:.2f}, believed was {stated.charge - away:.2f}"
        was_docked = stated.docked or (suspicion is not None and suspicion.was_docked)
        if reason is None or (suspicion is None and standing.from_ms < stated.at_ms):
            minutes = (stated.at_ms - standing.from_ms) / MS_PER_MIN
            reason = f"its reading stands: {standing.reading:.2f} for {minutes:.0f} min of its time"
            seen = extended(before.track, standing.since or stated)
            doubted = self._weigher.stood(replace(twin_state, track=seen), schedule, reading)
            return replace(doubted, suspicion=Suspicion(reason, was_docked, standing.reading))
        doubted = self._weigher.doubted(twin_state, schedule, reading)
        return replace(doubted, suspicion=Suspicion(reason, was_docked))

    def _charge_expected(self, twin_state: TwinState) -> float:
        rows = charge_now(twin_state, self.parameters, spent_hypotheses(twin_state, self.parameters))
        expected = charge.moment_matched([bounded(row, after_measuring=False) for row in rows]).mean
        return float(expected[charge.PRIMARY] + expected[charge.SENSOR])

    def _belief_after_status(
        self, belief: Belief, twin_state: TwinState, reading: Reading, at_ms: MissionMs
    ) -> Belief:
        heard = replace(belief, heard_ms=at_ms, predicted_ms=0, state=reading.state, silent_timeslots=0)
        return self._to_belief(heard, twin_state, at_ms, Source.PACKET)

    def _is_independent(self, twin_state: TwinState, agent_id: int, mode: Mode) -> bool:
        """True for the first of the readings that share a mode and a period; periods are staggered to balance the ticks."""
        if mode is not twin_state.measured_mode:
            return True
        apart_ms = self.parameters.sensor.apart_ms
        stagger_ms = agent_id * _STAGGER_MS % apart_ms
        return (twin_state.at_ms + stagger_ms) // apart_ms > (twin_state.measured_ms + stagger_ms) // apart_ms

    def _first_belief(self, packet: StatusPacket, reading: Reading, at_ms: MissionMs) -> Belief:
        parameters = self.parameters
        mean, cov = charge.prior_state(parameters)
        nominal_ms = parameters.scale.agent_ms(at_ms)
        ahead_ms, usual = packet.agent_ms - nominal_ms, parameters.clock
        clock = clocks.corrected(
            clocks.prior_clock(usual.offset_ms, usual.drift_ppm), ahead_ms, usual.reading_ms
        )
        if abs(ahead_ms) > _NEVER_SET_DEVIATIONS * math.hypot(usual.offset_ms, usual.reading_ms):
            clock = self._clock_set(packet.agent_ms, at_ms)
        place = Place.at(packet.north_m, packet.east_m, self._variance_of_place_m2(packet), parameters.water)
        twin_state = TwinState(
            at_ms=nominal_ms + round(clock.offset_ms),
            anchors=(Anchor(1.0, mean, cov),),
            anchor_ms=nominal_ms,
            load=Load.known(reading.mode if reading.mode in SUBMERGED else Mode.IDLE),
            situation=None,
            since_ms=nominal_ms,
            place=place,
            place_ms=at_ms,
            clock=clock,
            clock_ms=nominal_ms,
            packet=(packet.sequence, packet.agent_ms),
            reported=NOTHING_REPORTED.after(packet),
            stated_m=(packet.north_m, packet.east_m),
        )
        schedule = self._schedule(packet.agent_id)
        unknown = [Anchor(1.0, mean, cov)]
        twin_state = self._weigher.corrected(twin_state, schedule, unknown, reading, may_rest=False)
        if self._checkers is not None:
            charge_stated = parameters.sensor.primary_of(reading.state, reading.primary)
            stated = Stated(twin_state.at_ms, charge_stated, reading.mode in DOCKED)
            standing = self._checkers[0].standing(None, stated, reading.primary, reading.state, 0.0)
            twin_state = replace(twin_state, track=extended(None, stated), standing=standing)
        return belief_from_state(
            twin_state=twin_state,
            parameters=parameters,
            agent_id=packet.agent_id,
            heard_ms=at_ms,
            state=packet.state,
            at_ms=at_ms,
            learned_from=Source.PACKET,
            silent_timeslots=0,
        )

    def _clock_set(self, agent_ms: int, at_ms: MissionMs) -> ClockBelief:
        known = self.parameters.clock
        return clocks.set_to(
            agent_ms - self.parameters.scale.agent_ms(at_ms), known.reading_ms, known.drift_ppm
        )

    def _read_clock(self, twin_state: TwinState, packet: StatusPacket, at_ms: MissionMs) -> TwinState:
        nominal_ms = self.parameters.scale.agent_ms(at_ms)
        clock = clocks.propagated(twin_state.clock, nominal_ms - twin_state.clock_ms)
        clock = clocks.corrected(clock, packet.agent_ms - nominal_ms, self.parameters.clock.reading_ms)
        return replace(twin_state, clock=clock, clock_ms=nominal_ms)

    def _fixed(self, twin_state: TwinState, packet: StatusPacket, at_ms: int) -> TwinState:
        """Takes a packet's place as a fix.

        Below it is the last fix from the surface, which says nothing of the way down, and nothing new when it is repeated.
        """
        water, stated_m = self.parameters.water, (packet.north_m, packet.east_m)
        if water.is_ground_truth or _is_at_surface(packet):
            is_new = at_ms - twin_state.place_ms >= _FIX_APART_MS
        else:
            is_new = stated_m != twin_state.stated_m
        twin_state = replace(twin_state, stated_m=stated_m)
        if not is_new:
            return twin_state
        place = self._place(twin_state, at_ms).corrected_by_fix(
            *stated_m, self._variance_of_place_m2(packet), water
        )
        return replace(twin_state, place=place, place_ms=at_ms)

    def _variance_of_place_m2(self, packet: StatusPacket) -> float:
        water = self.parameters.water
        came_down = not (water.is_ground_truth or _is_at_surface(packet))
        return water.fix_deviation_m**2 + came_down * water.way_down_variance_m2
