"""One go-to of generation B, from its order to what became of it: its status topic names no order, and may be silent."""

from __future__ import annotations

import math

from apad_bridge.ros.generation_b_status import StatusWatch
from apad_bridge.vehicle.commands import GoTo, PoseReported
from apad_bridge.vehicle.generation_b.messages import GoToOrder, Status

NEAR_M = 1.0
"""Beyond the victory radius: a go-to that is said to be done farther away than that is not believed."""
SILENT_MS = 3_000
"""In the victory radius for so long, without a word on `goto_status`, is arrival."""


class Going:
    def __init__(self, command: GoTo) -> None:
        self.command = command
        self._watch = StatusWatch()
        self._near_since_ms: int | None = None

    @property
    def order(self) -> GoToOrder | None:
        """None for one that the vehicle would abort without a word."""
        command = self.command
        numbers = (command.north_m, command.east_m, command.speed_m_s, command.victory_radius_m)
        if not all(map(math.isfinite, numbers)) or command.speed_m_s <= 0 or command.victory_radius_m <= 0:
            return None
        return GoToOrder(*numbers)

    def distance_m(self, pose: PoseReported | None) -> float:
        if pose is None:
            return math.inf
        return math.hypot(self.command.north_m - pose.north_m, self.command.east_m - pose.east_m)

    def hear(self, status: Status, at_ms: int, pose: PoseReported | None, *, answered: bool) -> bool:
        """Whether the vehicle says that it is done; `is_near` tells whether to believe it."""
        return self._watch.hear(status, at_ms, answered=answered, plausible=self.is_near(pose))

    def is_near(self, pose: PoseReported | None) -> bool:
        return self.distance_m(pose) <= self.command.victory_radius_m + NEAR_M

    def why_lost(self, now_ms: int) -> str | None:
        why = self._watch.why_lost(now_ms)
        return None if why is None else f"the aPad ended the go-to by itself: {why}"

    def has_arrived_unsaid(self, pose: PoseReported | None, now_ms: int) -> bool:
        """It has been there for a while, and nothing at all was heard of its status."""
        if self._watch.was_heard or self.distance_m(pose) > self.command.victory_radius_m:
            self._near_since_ms = None
        elif self._near_since_ms is None:
            self._near_since_ms = now_ms
        return self._near_since_ms is not None and now_ms - self._near_since_ms >= SILENT_MS
