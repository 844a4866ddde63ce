"""Keeps the stop in force of one vehicle: sends it, repeats it while it is due, and judges if the hull obeys.

It goes out at once, and again each second until the hull obeys it and no order that it cut can be carried out any more. A
HOLD becomes OFF where the vehicle may not hold, does not take it, or does not obey it. A stop that a former supervisor left
in force goes on where that one ended.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

from apad_bridge.events.guard_events import Drifting, StopKind
from apad_bridge.vehicle.commands import Hold, Stop, VehicleCommand
from apad_bridge.vehicle.guards.gate import PILOT_STEERS, Safety
from apad_bridge.vehicle.guards.guarded_orders import Point, may_hold
from apad_bridge.vehicle.guards.stop_obedience import Obedience, Obeys, Sight
from apad_bridge.vehicle.guards.stops import SIMULATED_TAKEN_MS, TAKEN_MS
from apad_bridge.vehicle.guards.watchdog_watch import FIRST_STATE_MS
from apad_bridge.vehicle.vehicle_link import Cleared

REST_M = 0.5
REST_MS = 3_000
"""A vehicle that stays within `REST_M` for so long is at rest."""
DRIFT_MS = 10_000
"""So often the operator is told where a vehicle without thrust drifts."""
REPEAT_MS = 1_000
AFTER_CUT_MS = 5_000
"""A stop is repeated so often, until the hull obeys and the newest order that it cut lies so far back. The vehicle may
carry such an order out late: a connection's end does not end what its server has begun."""
BLIND_MS = 10_000
"""A stop that was taken is repeated for so long where no position tells if the hull obeys."""


class StopEnforcer:
    """`send` sends an order that the gate has let out, `take_id` gives it an id. Times are mission ms."""

    def __init__(
        self,
        safety: Safety,
        send: Callable[[Cleared[VehicleCommand], int], None],
        take_id: Callable[[], int],
    ) -> None:
        self._safety = safety
        self._gate = safety.gate
        self._stops = safety.gate.stops
        self._send = send
        self._take_id = take_id
        self._rest: tuple[int, Point] | None = None
        """Since when, and where, the vehicle has been at one place."""
        self._drift_ms: int | None = None
        """The time of the newest message about the drift."""
        self._obedience: Obedience | None = None
        """Follows the hull from the acceptance of the stop in force on; None before."""
        self._drifts = False
        """The hull had no thrust when the stop in force came: only the water moves it."""
        self._cut_ms: int | None = None
        """The time of the newest order that a stop has cut."""
        self._stop_ms: int | None = None
        """The time at which the stop in force went out last, until the vehicle answers; None when it has."""
        self._repeat_ms: int | None = None
        """The time from which on the stop in force is due again."""
        self._restored_ms: int | None = None
        """The time of the first look at it."""
        self._restored = self._stops.in_force
        """The stop that a former supervisor left in force, until it is decided whether it goes out again."""

    @property
    def is_judging(self) -> bool:
        """The vehicle has taken the stop in force, and its hull has not obeyed yet."""
        stop = self._stops.in_force
        return self._obedience is not None and stop is not None and stop.obeyed_ms is None

    def begin(
        self,
        kind: StopKind,
        by: str,
        reason: str,
        now_ms: int,
        *,
        is_persons: bool = False,
        stills_arms: bool = False,
    ) -> None:
        """Begins a stop, and sends it."""
        before = self._stops.in_force
        self._drifts = before is not None and before.kind is StopKind.OFF and before.obeyed_ms is not None
        self._stops.begin(kind, by, reason, now_ms, is_persons=is_persons, stills_arms=stills_arms)
        self._stops.way_back = self._rest = self._drift_ms = None
        self._obedience = None
        self.send(now_ms)

    def go_on(self, now_ms: int) -> None:
        """Sends a restored OFF again, and a restored HOLD that nobody knows to be taken, as soon as it may hold.

        A hull that has left the place to hold meanwhile gets OFF: a way back to it would be a motion of ours. So does one
        whose watchdog may have switched its thrusters off: a HOLD would start them.
        """
        if (stop := self._restored) is None:
            return
        if self._restored_ms is None:
            self._restored_ms = now_ms
        waited_ms = now_ms - self._restored_ms
        is_blind = stop.kind is StopKind.HOLD and not may_hold(self._gate.situation(now_ms))
        is_early = (
            stop.kind is StopKind.HOLD and not self._gate.watchdog.is_heard and waited_ms < FIRST_STATE_MS
        )
        if stop.kind is StopKind.HOLD and (stop.taken_ms is not None or stop.stills_arms):
            self._restored = None  # the vehicle holds by itself, or hands are near its thrusters
        elif self._stops.in_force is not stop:
            self._restored = None  # another stop has come
        elif waited_ms >= TAKEN_MS or not (is_blind or is_early):
            self._restored = None
            if reason := self._why_not_hold_late(now_ms):
                self.become_off(reason, now_ms)
            self.send(now_ms)

    def _why_not_hold_late(self, now_ms: int) -> str:
        """The reason why the HOLD in force, which a former supervisor ordered, may not go out; empty where it may."""
        stop, place_m = self._stops.in_force, self._gate.situation(now_ms).place_m
        if stop is None or stop.kind is StopKind.OFF:
            return ""
        if self._gate.watchdog.may_have_put_off:
            return "the vehicle's watchdog may have switched the thrusters off, and nobody knows that the hold was taken"
        if stop.place_m is None or place_m is None:
            return ""
        away_m, stopping = math.dist(stop.place_m, place_m), self._safety.stopping
        if away_m <= stopping.way_m(stopping.coasting_speed_m_s):
            return ""
        return f"the aPad is {away_m:.1f} m from the place to hold, which nobody knows that it took"

    def note_cut(self, now_ms: int) -> None:
        """A stop has ended an order on its way, which the vehicle may carry out late."""
        self._cut_ms = now_ms

    def note_continued(self) -> None:
        """A person lets the vehicle move again."""
        self._stops.way_back = self._drift_ms = None

    def leave_to_pilot(self) -> None:
        """The pilot ends every order of ours. Nothing goes out, and nothing when the pilot lets go."""
        self._stops.way_back = self._obedience = self._repeat_ms = None

    def send(self, now_ms: int) -> None:
        """Sends the stop in force; a HOLD becomes OFF where the vehicle may not hold any more."""
        stop, situation = self._stops.in_force, self._gate.situation(now_ms)
        if stop is None or self._gate.pilot == PILOT_STEERS:
            return
        if stop.kind is StopKind.HOLD and not may_hold(situation):
            self.become_off(situation.position_fault or situation.outside, now_ms)
        command_id = self._take_id()
        self._stop_ms, self._repeat_ms = now_ms, now_ms + REPEAT_MS
        self._stops.sent(command_id, now_ms, situation.place_m)
        stop = self._stops.in_force
        if stop is not None and stop.place_m is not None:
            self._send(self._gate.clear_stop(Hold(command_id, *stop.place_m, pre_empts=True)), now_ms)
        else:
            self._send(self._gate.clear_stop(Stop(command_id)), now_ms)

    def become_off(self, reason: str, now_ms: int) -> None:
        self._obedience = None
        self._stops.become_off(reason, now_ms)

    def send_again(self, reason: str, now_ms: int) -> None:
        """Sends the stop in force to a vehicle that moves in spite of it: it comes before other clients."""
        self._stops.order_again(reason, now_ms)
        self._rest = self._obedience = None
        self.send(now_ms)

    def taken(self, now_ms: int) -> None:
        self._stop_ms = None
        self._stops.taken(now_ms)
        stop, situation = self._stops.in_force, self._gate.situation(now_ms)
        if stop is not None and self._obedience is None and situation.place_m is not None:
            sight = self._sight(situation.place_m, now_ms)
            self._obedience = Obedience(stop.kind, stop.place_m, self._safety.stopping, sight)

    def _sight(self, place_m: Point, now_ms: int) -> Sight:
        watch = self._gate.watch
        flow_m_s = watch.velocity_m_s if self._drifts else self._safety.drift_m_s(place_m, now_ms)
        return Sight(now_ms, place_m, watch.velocity_m_s, flow_m_s, watch.noise.way_error_m)

    def failed(self, reason: str, now_ms: int) -> None:
        """The vehicle has not taken the stop: OFF in place of a HOLD. An OFF is due again."""
        stop = self._stops.in_force
        assert stop is not None
        if self._gate.pilot == PILOT_STEERS:
            # A pilot ends a stop that was taken, too. Nothing goes out, and nothing when the pilot lets go.
            self._stops.failed(self._gate.pilot, now_ms)
            self._repeat_ms = None
            return
        self._stop_ms = None
        self._stops.failed(reason, now_ms)
        if stop.kind is StopKind.HOLD:
            self.become_off(f"the vehicle did not take the hold: {reason}", now_ms)
            self.send(now_ms)

    def watch(self, now_ms: int) -> None:
        if (stop := self._stops.in_force) is None:
            return
        patience_ms = TAKEN_MS if self._safety.needs_person else SIMULATED_TAKEN_MS
        if self._stops.is_overdue(now_ms, patience_ms):
            self._stop_overdue(stop.kind, now_ms)
        situation = self._gate.situation(now_ms)
        place_m = None if situation.position_fault else situation.place_m
        self._stops.blind(situation.position_fault)
        self._judge_hull(place_m, now_ms)
        if place_m is None:
            self._rest = None
        elif self._rest is None or math.dist(self._rest[1], place_m) > REST_M:
            self._rest = now_ms, place_m
        elif now_ms - self._rest[0] >= REST_MS:
            self._stops.at_rest(now_ms)
        if stop.kind is StopKind.OFF and (self._drift_ms is None or now_ms - self._drift_ms >= DRIFT_MS):
            self._drift_ms = now_ms
            self._gate.events.append(self._drift(now_ms))

    def _judge_hull(self, place_m: Point | None, now_ms: int) -> None:
        """Follows the hull by its believed place, None for none, and repeats the stop while it is due."""
        obeys = Obeys.UNKNOWN
        if self._obedience is not None and place_m is not None and self._stops.way_back is None:
            obeys = self._obedience.look(self._sight(place_m, now_ms))
        stop = self._stops.in_force
        assert stop is not None
        if obeys is Obeys.YES and not self._may_act_late(now_ms):
            self._stops.obeyed(now_ms)
        elif obeys is Obeys.NO and self._obedience is not None:
            reason = self._obedience.reason
            self._stops.disobeyed(reason, now_ms)
            if stop.kind is StopKind.HOLD:
                self.become_off(reason, now_ms)
                self.send(now_ms)
        if self._is_due_again(obeys, now_ms):
            self.send(now_ms)

    def _is_due_again(self, obeys: Obeys, now_ms: int) -> bool:
        stop = self._stops.in_force
        if stop is None or self._stop_ms is not None or self._repeat_ms is None or now_ms < self._repeat_ms:
            return False  # one call at a time: a vehicle that is busy carries out no backlog
        if self._stops.way_back is not None:
            return False
        if self._may_act_late(now_ms):
            return True
        if stop.kind is StopKind.HOLD or obeys is Obeys.YES:
            return False
        return stop.taken_ms is None or bool(stop.not_obeyed) or now_ms - stop.taken_ms < BLIND_MS

    def _may_act_late(self, now_ms: int) -> bool:
        """The vehicle may still begin with an order that was cut, so that a hull at rest tells nothing."""
        return self._cut_ms is not None and now_ms - self._cut_ms < AFTER_CUT_MS

    def _stop_overdue(self, kind: StopKind, now_ms: int) -> None:
        reason = "the vehicle has not answered"
        if kind is StopKind.HOLD:
            self.failed(reason, now_ms)
        else:
            self._stop_ms = None
            self._stops.failed(reason, now_ms)

    def _drift(self, now_ms: int) -> Drifting:
        """The course of a vehicle without thrust, by its last speed or the known sea, and when it would get out."""
        situation = self._gate.situation(now_ms)
        velocity_m_s = (0.0, 0.0) if situation.position_fault else situation.velocity_m_s
        if math.hypot(*velocity_m_s) < 0.05 and situation.place_m is not None:
            velocity_m_s = self._safety.drift_m_s(situation.place_m, now_ms)
        speed_m_s = math.hypot(*velocity_m_s)
        course = Drifting(
            round(speed_m_s, 3), round(math.atan2(velocity_m_s[1], velocity_m_s[0]), 3), fence_s=None
        )
        if situation.place_m is None:
            return course
        way_m = self._safety.waters.way_out_m(situation.place_m, velocity_m_s) if speed_m_s > 0 else None
        return replace(
            course,
            fence_s=None if way_m is None else round(way_m / speed_m_s),
            north_m=round(situation.place_m[0], 2),
            east_m=round(situation.place_m[1], 2),
            is_believed=not situation.position_fault,
        )
