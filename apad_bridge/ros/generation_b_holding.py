"""A position that an aPad of generation B was told to hold: nothing says whether it does, but where it is."""

from __future__ import annotations

import math
from dataclasses import dataclass

from apad_bridge.ros.generation_b_words import PositionOrder
from apad_bridge.vehicle import Hold, PoseReported

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

    def is_astray(self, pose: PoseReported | None, now_ms: int) -> bool:
        if pose is None or now_ms - self.told_ms < ASTRAY_MS:
            return False
        away_m = math.hypot(self.order.north_m - pose.north_m, self.order.east_m - pose.east_m)
        return away_m > ASTRAY_M


def holding_of(command: Hold, now_ms: int) -> Holding:
    return Holding(PositionOrder(command.north_m, command.east_m, command.heading_rad), now_ms, command)
