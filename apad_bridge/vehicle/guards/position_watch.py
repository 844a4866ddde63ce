"""Judges a vehicle's position: known, fresh, plausible, and moving when the vehicle is under way."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

from apad_bridge.beliefs.input_ranges import out_of_range
from apad_bridge.vehicle.commands import PoseReported
from apad_bridge.vehicle.guards.orders import Point

VELOCITY_MS = 2_000
"""The velocity is the mean over the newest positions of so long."""
SETTLED_MS = 10_000
"""A position that has jumped is believed again after so long without another jump."""


NEVER_MS = 10**15


THERE_M = 1.0
"""Farther than this from its goal, a vehicle is under way."""


@dataclass(frozen=True, slots=True)
class PositionLimits:
    age_ms: int = 5_000
    """The greatest age of a usable position."""
    jump_m: float = 10.0
    """A position farther than this from where the vehicle can have come has jumped."""
    speed_m_s: float = 2.0
    """The speed that the vehicle can reach, for what it can have come."""
    frozen_ms: int = 10_000
    """A position that stays the same to the last bit for so long, while the vehicle is under way, is frozen."""


class PositionWatch:
    """Takes each reported pose; `fault` is the reason not to use the newest, empty for a good one."""

    def __init__(self, limits: PositionLimits) -> None:
        self._limits = limits
        self._poses: deque[PoseReported] = deque()
        """The poses of the last `VELOCITY_MS`, the newest last."""
        self._jumped_ms: int | None = None
        self._frozen_ms = 0
        """Time under way with a position that stayed the same to the last bit."""
        self._goal_m: Point | None = None

    @property
    def place_m(self) -> Point | None:
        """The newest place, good or bad."""
        return (self._poses[-1].north_m, self._poses[-1].east_m) if self._poses else None

    @property
    def velocity_m_s(self) -> Point:
        if len(self._poses) < 2 or self._poses[-1].at_ms == self._poses[0].at_ms:
            return (0.0, 0.0)
        first, last = self._poses[0], self._poses[-1]
        seconds = (last.at_ms - first.at_ms) / 1000
        return (last.north_m - first.north_m) / seconds, (last.east_m - first.east_m) / seconds

    def take(self, pose: PoseReported) -> None:
        """Takes a pose; one that is older than the newest, or the same again, changes nothing."""
        if out_of_range(north_m=pose.north_m, east_m=pose.east_m) is not None:
            return
        newest = self._poses[-1] if self._poses else None
        if newest is not None and pose.at_ms <= newest.at_ms:
            return
        if newest is None or _bits(newest) != _bits(pose):
            self._frozen_ms = 0
        elif self._goal_m is not None and math.dist(self._goal_m, (pose.north_m, pose.east_m)) > THERE_M:
            # It adds up over orders, and stays when the vehicle is told to stop: only a motion ends it.
            self._frozen_ms += pose.at_ms - newest.at_ms
        if newest is not None and self._is_jump(newest, pose):
            self._jumped_ms = pose.at_ms
            self._poses.clear()  # no velocity across a jump
        self._poses.append(pose)
        while len(self._poses) > 2 and pose.at_ms - self._poses[1].at_ms >= VELOCITY_MS:
            self._poses.popleft()

    def note_goal(self, goal_m: Point | None) -> None:
        """The place to which the vehicle was ordered last, or which it holds; None for none."""
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

    def _is_jump(self, before: PoseReported, after: PoseReported) -> bool:
        way_m = math.dist((before.north_m, before.east_m), (after.north_m, after.east_m))
        seconds = (after.at_ms - before.at_ms) / 1000
        return way_m > self._limits.jump_m + self._limits.speed_m_s * seconds


def _bits(pose: PoseReported) -> tuple[float, float, float]:
    return pose.north_m, pose.east_m, pose.heading_rad
