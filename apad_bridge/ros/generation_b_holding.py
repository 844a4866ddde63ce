"""A position that an aPad of generation B was told to hold: nothing says whether it does, but where it is.

What pre-empts a hold past us shows itself, though: a go-to by `goto_status`, a docking by `docking_status`. Whoever ordered
it is not fought: it is let end, and the hold told again after it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from apad_bridge.vehicle.commands import Hold, PoseReported
from apad_bridge.vehicle.generation_b.messages import PositionOrder, Status

ASTRAY_M = 3.0
"""A vehicle that shall hold and is this far away does not."""
ASTRAY_MS = 10_000
"""So often, at most, it is told again."""


@dataclass(slots=True)
class Holding:
    order: PositionOrder
    told_ms: int
    command: Hold | None = None
    """None when nobody commanded it: whatever ends leaves the controllers off, and is followed by a hold."""

    is_quiet: bool = False
    """Since it was taken, `goto_status` has said that no go-to runs: one that runs later is another's."""
    is_lost: bool = False
    """Something that nobody here ordered has pre-empted it."""
    others_since_ms: int | None = None
    """When a go-to of another's was first heard to run that was not heard to end."""

    def hear_going(self, status: Status, at_ms: int, *, answered: bool) -> bool:
        """A word of `goto_status`. Whether it tells of a go-to of another's that was not noticed before.

        Late words about a go-to of ours come before one that it is over.
        """
        if status is not Status.RUNNING:
            self.is_quiet = self.is_quiet or answered
            self.others_since_ms = None
            return False
        is_new = self.is_quiet and self.others_since_ms is None
        if is_new:
            self.is_lost, self.others_since_ms = True, at_ms
        return is_new

    def is_left_alone(self, now_ms: int, timeout_s: float) -> bool:
        return self.others_since_ms is not None and now_ms - self.others_since_ms < timeout_s * 1000

    def tell_again(self, now_ms: int) -> PositionOrder:
        self.told_ms, self.is_quiet, self.is_lost, self.others_since_ms = now_ms, False, False, None
        return self.order

    def is_astray(self, pose: PoseReported | None, now_ms: int) -> bool:
        if now_ms - self.told_ms < ASTRAY_MS:
            return False
        if self.is_lost or pose is None:
            return self.is_lost
        away_m = math.hypot(self.order.north_m - pose.north_m, self.order.east_m - pose.east_m)
        return away_m > ASTRAY_M


def holding_of(command: Hold, now_ms: int) -> Holding:
    return Holding(PositionOrder(command.north_m, command.east_m, command.heading_rad), now_ms, command)
