"""Judges a vehicle's position: known, fresh, plausible, and moving when the vehicle is under way.

A poor link delays positions, and delivers several at once. So ways are measured by the positions' own stamps, the
vehicle's clock, and only the age by their arrival. A position without a stamp has its arrival alone.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, replace

from apad_bridge.beliefs.input_ranges import out_of_range
from apad_bridge.vehicle.commands import PoseReported
from apad_bridge.vehicle.guards.orders import Point

VELOCITY_MS = 2_000
"""The velocity is the mean over the newest positions of so long."""
SETTLED_MS = 10_000
"""A position that has jumped is believed again after so long without another jump."""
PLACE_ERROR_M = 0.1
"""The error of the way between two positions of the last two seconds (a GPS, after the vehicle's filter)."""
ARRIVAL_ERROR_MS = 1_000
"""The error of the time between two positions without stamps: it is the ticks of their arrival."""
CLOCK_SET_MS = 5_000
"""Stamps and arrivals that differ by more tell that the vehicle's clock was set."""
LEAST_DELAY_MS = 60_000
"""The least delay of a position is that of the last one or two such spans."""


NEVER_MS = 10**15


THERE_M = 1.0
"""Farther than this from its goal, a vehicle is under way."""


@dataclass(frozen=True, slots=True)
class PositionLimits:
    age_ms: int = 2_000
    """The greatest age of a usable position."""
    jump_m: float = 10.0
    """A position farther than this from where the vehicle can have come has jumped."""
    speed_m_s: float = 2.0
    """The speed that the vehicle can reach, for what it can have come."""
    frozen_ms: int = 2_000
    """A position that stays the same to the last bit for so long, while the vehicle is under way, is frozen."""


class _VehicleClock:
    """The clock of the vehicle's stamps, beside mission time."""

    def __init__(self) -> None:
        self._newest: PoseReported | None = None
        """The newest pose with a stamp."""
        self._since_ms = 0
        self._least_ms: int | None = None
        """The least of mission time at arrival less the stamp, since `_since_ms`."""
        self._least_before_ms: int | None = None

    def stands_still(self, pose: PoseReported) -> bool:
        """Its stamp is the one before: such stamps are no times."""
        newest = self._newest
        return newest is not None and pose.stamp_ms is not None and pose.stamp_ms == newest.stamp_ms

    def was_set(self, pose: PoseReported) -> bool:
        newest = self._newest
        if newest is None or pose.stamp_ms is None:
            return False
        span_ms = _span_ms(newest, pose)
        return span_ms < 0 or abs(span_ms - (pose.at_ms - newest.at_ms)) > CLOCK_SET_MS

    def take(self, pose: PoseReported) -> None:
        if pose.stamp_ms is None:
            return
        self._newest = pose
        if pose.at_ms - self._since_ms >= LEAST_DELAY_MS:
            self._since_ms, self._least_before_ms, self._least_ms = pose.at_ms, self._least_ms, None
        offset_ms = pose.at_ms - pose.stamp_ms
        self._least_ms = offset_ms if self._least_ms is None else min(self._least_ms, offset_ms)

    def earliest_ms(self, pose: PoseReported) -> int:
        """The mission time at which this position would have come without more than the least delay."""
        known = [it for it in (self._least_ms, self._least_before_ms) if it is not None]
        return pose.at_ms if pose.stamp_ms is None or not known else pose.stamp_ms + min(known)


class PositionWatch:
    """Takes each reported pose; `fault` is the reason not to use the newest, empty for a good one."""

    def __init__(self, limits: PositionLimits) -> None:
        self._limits = limits
        self._poses: deque[PoseReported] = deque()
        """The poses of the last `VELOCITY_MS`, the newest last."""
        self._clock = _VehicleClock()
        self._jumped_ms: int | None = None
        self._frozen_ms = 0
        """Time under way with a position that stayed the same to the last bit."""
        self._goal_m: Point | None = None
        self._under_way_ms = 0
        """The time at which the vehicle accepted the order by which it is under way."""

    @property
    def place_m(self) -> Point | None:
        """The newest place, good or bad."""
        return _place(self._poses[-1]) if self._poses else None

    @property
    def velocity_m_s(self) -> Point:
        seconds, _ = self._span_s()
        if seconds <= 0.0:
            return (0.0, 0.0)
        first, last = self._poses[0], self._poses[-1]
        return (last.north_m - first.north_m) / seconds, (last.east_m - first.east_m) / seconds

    @property
    def least_speed_m_s(self) -> float:
        """The speed that the vehicle makes at least, by the errors of places and times."""
        seconds, error_s = self._span_s()
        if seconds <= 0.0:
            return 0.0
        way_m = math.dist(_place(self._poses[0]), _place(self._poses[-1]))
        return max(0.0, way_m - PLACE_ERROR_M) / (seconds + error_s)

    def take(self, pose: PoseReported) -> None:
        """Takes a pose; one that is older than the newest, or the same again, changes nothing."""
        if out_of_range(north_m=pose.north_m, east_m=pose.east_m) is not None:
            return
        newest = self._poses[-1] if self._poses else None
        if newest is not None and pose.at_ms <= newest.at_ms:
            return
        if self._clock.stands_still(pose):
            pose = replace(pose, stamp_ms=None)
        elif self._clock.was_set(pose):
            self._clock = _VehicleClock()
            self._poses.clear()  # no velocity across two clocks
            newest = None if newest is None else replace(newest, stamp_ms=None)
        self._clock.take(pose)
        if newest is None or _bits(newest) != _bits(pose):
            self._frozen_ms = 0
        elif self._is_under_way(pose) and self._clock.earliest_ms(newest) >= self._under_way_ms:
            # It adds up over orders, and stays when the vehicle is told to stop: only a motion ends it.
            self._frozen_ms += _span_ms(newest, pose)
        if newest is not None and self._is_jump(newest, pose):
            self._jumped_ms = pose.at_ms
            self._poses.clear()  # no velocity across a jump
        self._poses.append(pose)
        while len(self._poses) > 2 and _span_ms(self._poses[1], pose) >= VELOCITY_MS:
            self._poses.popleft()

    def note_goal(self, goal_m: Point | None, at_ms: int = 0) -> None:
        """The place to which the vehicle goes, or where it stays, by an order accepted at `at_ms`; None for none."""
        if not self._poses or not self._is_under_way(self._poses[-1]):
            self._under_way_ms = at_ms
        self._goal_m = goal_m

    def fault(self, now_ms: int) -> str:
        limits = self._limits
        if not self._poses:
            return "the aPad's position is not known"
        age_ms = now_ms - self._poses[-1].at_ms
        if age_ms > limits.age_ms:
            return f"the aPad's position is older than {limits.age_ms / 1000:g} s"
        if self._jumped_ms is not None and now_ms - self._jumped_ms < SETTLED_MS:
            return f"the aPad's position has jumped within the last {SETTLED_MS / 1000:g} s"
        if self._frozen_ms >= limits.frozen_ms:
            return f"the aPad's position has not changed at all for {limits.frozen_ms / 1000:g} s under way"
        return ""

    def _is_under_way(self, pose: PoseReported) -> bool:
        return self._goal_m is not None and math.dist(self._goal_m, _place(pose)) > THERE_M

    def _is_jump(self, before: PoseReported, after: PoseReported) -> bool:
        seconds = (_span_ms(before, after) + _error_ms(before, after)) / 1000
        way_m = math.dist(_place(before), _place(after))
        return way_m > self._limits.jump_m + self._limits.speed_m_s * seconds

    def _span_s(self) -> tuple[float, float]:
        """The time between the oldest and the newest pose, and its error; (0, 0) before there are two."""
        if len(self._poses) < 2:
            return 0.0, 0.0
        first, last = self._poses[0], self._poses[-1]
        return _span_ms(first, last) / 1000, _error_ms(first, last) / 1000


def _span_ms(before: PoseReported, after: PoseReported) -> int:
    if before.stamp_ms is None or after.stamp_ms is None:
        return after.at_ms - before.at_ms
    return after.stamp_ms - before.stamp_ms


def _error_ms(before: PoseReported, after: PoseReported) -> int:
    return ARRIVAL_ERROR_MS if before.stamp_ms is None or after.stamp_ms is None else 0


def _place(pose: PoseReported) -> Point:
    return pose.north_m, pose.east_m


def _bits(pose: PoseReported) -> tuple[float, float, float]:
    return pose.north_m, pose.east_m, pose.heading_rad
