"""Three witnesses of a position that is frozen while the vehicle is under way.

It does not change at all, to the last bit; or it contradicts the speed that the vehicle measures; or it moves less than its
own noise at rest.
"""

from __future__ import annotations

import math
from collections import deque
from itertools import pairwise

from apad_bridge.vehicle.commands import PoseReported
from apad_bridge.vehicle.guards.guarded_orders import Point
from apad_bridge.vehicle.guards.position_noise import NOISE_ERRORS, PositionNoise, mean_square
from apad_bridge.vehicle.guards.vehicle_clock import VehicleClock, span_ms

SAMPLE_MS = 800
"""The least time between two samples."""
NEVER_MS = 10**15
THERE_M = 1.0
"""Farther than this from its goal, a vehicle is under way."""
WITNESS_MS = 5_000
"""The vehicle's own speed, and the noise of its position, are compared with its ways of at most so long."""
WITNESS_WAY_M = 1.0
"""The least way that the vehicle's own speed must make, before a position that does not follow contradicts it."""
WITNESS_SHARE = 0.3
"""A position that makes less than this share of that way contradicts it."""
STILL_SHARE = 0.2
"""A position under way whose every step is below this share of those at rest is frozen."""
LEAST_NOISE_M = 0.02
"""Smaller steps at rest than this tell nothing about a position that stands still."""


class FrozenPosition:
    """Takes every position, and samples that are at least `SAMPLE_MS` apart."""

    def __init__(self, limit_ms: int, noise: PositionNoise) -> None:
        """A position that stays the same to the last bit for `limit_ms` is frozen; `NEVER_MS` for no such limit."""
        self._limit_ms = limit_ms
        self._noise = noise
        self._goal_m: Point | None = None
        self._under_way_ms = 0
        """The time at which the vehicle accepted the order by which it is under way."""
        self._same_ms = 0
        """The time under way with a position that stayed the same to the last bit."""
        self._samples: deque[PoseReported] = deque()
        """The samples of the last `WITNESS_MS` since the vehicle is under way, the newest last."""
        self._rest_m2: float | None = None
        """The mean square of the steps at rest."""

    def note_goal(self, goal_m: Point | None, at_ms: int, newest: PoseReported | None) -> None:
        """The place to which the vehicle goes, or where it stays, by an order accepted at `at_ms`; None for none."""
        if newest is None or not self._is_under_way(newest):
            self._under_way_ms = at_ms
        self._goal_m = goal_m

    @property
    def never_changes(self) -> bool:
        return self._same_ms >= self._limit_ms

    @property
    def text(self) -> str:
        return f"has not changed at all for {self._limit_ms / 1000:g} s under way"

    def take(self, newest: PoseReported | None, pose: PoseReported, clock: VehicleClock) -> None:
        """The first witness; `newest` is the position before."""
        if newest is None or _bits(newest) != _bits(pose):
            self._same_ms = 0
        elif self._is_under_way(pose) and clock.earliest_ms(newest) >= self._under_way_ms:
            # It adds up over orders, and stays when the vehicle is told to stop: only a motion ends it.
            self._same_ms += span_ms(newest, pose)

    def take_sample(self, before: PoseReported | None, pose: PoseReported, clock: VehicleClock) -> str:
        """The reason of the other witnesses; empty for none. `before` is the sample before."""
        if self._limit_ms == NEVER_MS:
            return ""
        if not self._is_under_way(pose) or clock.earliest_ms(pose) < self._under_way_ms:
            self._learn_rest(before, pose)
            self._samples.clear()
            return ""
        self._samples.append(pose)
        while len(self._samples) > 2 and span_ms(self._samples[1], pose) >= WITNESS_MS:
            self._samples.popleft()
        return self._contradiction()

    def forget_the_way(self) -> None:
        """The position has jumped, or the vehicle's clock was set."""
        self._samples.clear()

    def forget(self) -> None:
        """A person believes the position."""
        self._samples.clear()
        self._same_ms = 0

    def _learn_rest(self, before: PoseReported | None, pose: PoseReported) -> None:
        if before is None or self._goal_m is None or not SAMPLE_MS <= span_ms(before, pose) <= WITNESS_MS:
            return
        self._rest_m2 = mean_square(self._rest_m2, math.dist(before.place_m, pose.place_m) ** 2)

    def _contradiction(self) -> str:
        """The reason why the positions under way contradict the vehicle's own speed, or their own noise.

        All positions of the time must lie in one spot. Noise brings two of a moving vehicle together now and then.
        """
        poses = list(self._samples)
        measured_m = spread_m = 0.0
        for n in range(len(poses) - 1, 0, -1):
            before, after = poses[n - 1], poses[n]
            if before.speed_m_s is None or after.speed_m_s is None:
                break
            measured_m += (before.speed_m_s + after.speed_m_s) / 2 * span_ms(before, after) / 1000
            spread_m = max(spread_m, *(math.dist(before.place_m, it.place_m) for it in poses[n:]))
            least_m = max(WITNESS_WAY_M, NOISE_ERRORS * self._noise.step_m / (1 - WITNESS_SHARE))
            if measured_m >= least_m and spread_m < WITNESS_SHARE * measured_m:
                return f"it moved by {spread_m:.1f} m while the vehicle measured a way of {measured_m:.1f} m"
        if len(poses) < 2 or span_ms(poses[0], poses[-1]) < WITNESS_MS:
            return ""
        noise_m = 0.0 if self._rest_m2 is None else math.sqrt(self._rest_m2)
        steps_m = [math.dist(one.place_m, next_one.place_m) for one, next_one in pairwise(poses)]
        if noise_m >= LEAST_NOISE_M and max(steps_m) < STILL_SHARE * noise_m:
            return f"it moves by {max(steps_m):.3f} m a second under way, and by {noise_m:.2f} m at rest"
        return ""

    def _is_under_way(self, pose: PoseReported) -> bool:
        return self._goal_m is not None and math.dist(self._goal_m, pose.place_m) > THERE_M


def _bits(pose: PoseReported) -> tuple[float, float, float]:
    return pose.north_m, pose.east_m, pose.heading_rad
