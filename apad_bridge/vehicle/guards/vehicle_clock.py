"""The clock of a vehicle's stamps beside the times at which its positions arrive: lateness, steps, and a growing delay."""

from __future__ import annotations

from collections import deque

from apad_bridge.vehicle.commands import PoseReported

CLOCK_SET_MS = 5_000
"""Stamps and arrivals that differ by more tell that the vehicle's clock was set."""
BACK_MS = 100
"""Stamps that go back by more are no times of one clock. Positions keep their order on a connection."""
LEAST_DELAY_MS = 60_000
"""The least delay of a position is that of the last one or two such spans."""
RISE_MS = 30
GROWN_COUNT = 5
GROWN_MS = 500
GROWN_WITHIN_MS = 2_000
"""A delay that rises by `RISE_MS` or more from each of so many positions to the next, and by `GROWN_MS` in all within that
time, is a lag that goes on growing. A poor link makes one position late, or two, and then delivers all of them."""


def span_ms(before: PoseReported, after: PoseReported) -> int:
    """The time between two positions, by their stamps where both have one."""
    if before.stamp_ms is None or after.stamp_ms is None:
        return heard_ms(after) - heard_ms(before)
    return after.stamp_ms - before.stamp_ms


def heard_ms(pose: PoseReported) -> int:
    """The time of arrival. A tick that is late takes positions that are newer than its own time."""
    return pose.at_ms if pose.heard_ms is None else pose.heard_ms


class VehicleClock:
    """The clock of the vehicle's stamps, beside the times of arrival."""

    def __init__(self) -> None:
        self._newest: PoseReported | None = None
        """The newest pose with a stamp."""
        self._since_ms = 0
        self._least_ms: int | None = None
        """The least of the time of arrival less the stamp, since `_since_ms`."""
        self._least_before_ms: int | None = None
        self._rising: deque[tuple[int, int]] = deque()
        """The time of arrival, and what it is after the stamp: of the newest positions, while the second rises."""

    def stands_still(self, pose: PoseReported) -> bool:
        """Its stamp is the one before: such stamps are no times."""
        newest = self._newest
        return newest is not None and pose.stamp_ms is not None and pose.stamp_ms == newest.stamp_ms

    def was_set(self, pose: PoseReported) -> bool:
        newest = self._newest
        if newest is None or pose.stamp_ms is None:
            return False
        stamped_ms = span_ms(newest, pose)
        return stamped_ms < 0 or abs(stamped_ms - (heard_ms(pose) - heard_ms(newest))) > CLOCK_SET_MS

    def step_ms(self, pose: PoseReported) -> int:
        """The step of the stamps beyond what delays explain: ahead above 0, back below 0."""
        newest = self._newest
        if newest is None or pose.stamp_ms is None or newest.stamp_ms is None:
            return 0
        if pose.stamp_ms < newest.stamp_ms - BACK_MS:
            return pose.stamp_ms - newest.stamp_ms
        known = [it for it in (self._least_ms, self._least_before_ms) if it is not None]
        return max(0, min(known) - (heard_ms(pose) - pose.stamp_ms)) if known else 0

    @property
    def grown_ms(self) -> int:
        """The growth of the delay over the newest positions; 0 where fewer than `GROWN_COUNT` rise."""
        return self._rising[-1][1] - self._rising[0][1] if len(self._rising) >= GROWN_COUNT else 0

    def _look_if_it_grows(self, came_ms: int, offset_ms: int) -> None:
        if self._rising and offset_ms < self._rising[-1][1] + RISE_MS:
            self._rising.clear()
        self._rising.append((came_ms, offset_ms))
        while came_ms - self._rising[0][0] > GROWN_WITHIN_MS:
            self._rising.popleft()

    def take(self, pose: PoseReported) -> None:
        if pose.stamp_ms is None:
            return
        self._newest = pose
        came_ms = heard_ms(pose)
        offset_ms = came_ms - pose.stamp_ms
        self._look_if_it_grows(came_ms, offset_ms)
        if came_ms - self._since_ms >= LEAST_DELAY_MS:
            self._since_ms, self._least_before_ms, self._least_ms = came_ms, self._least_ms, None
        self._least_ms = offset_ms if self._least_ms is None else min(self._least_ms, offset_ms)

    def late_ms(self, pose: PoseReported) -> int:
        """The delay of this position beyond the least delay."""
        known = [it for it in (self._least_ms, self._least_before_ms) if it is not None]
        return 0 if pose.stamp_ms is None or not known else heard_ms(pose) - pose.stamp_ms - min(known)

    def earliest_ms(self, pose: PoseReported) -> int:
        """The mission time at which this position would have come without more than the least delay."""
        return pose.at_ms - self.late_ms(pose)
