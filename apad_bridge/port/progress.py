"""Whether a go-to still gets nearer: vehicles do not say when they are stuck."""

from __future__ import annotations

import math

from apad_bridge.vehicle.commands import PoseReported

PROGRESS_M = 0.5


class Progress:
    """Stalled at `deadline_ms`: `stall_ms` after the distance last shrank by `PROGRESS_M` since it last counted."""

    def __init__(
        self, north_m: float, east_m: float, stall_ms: int, now_ms: int, pose: PoseReported | None
    ) -> None:
        self._goal_m = (north_m, east_m)
        self._stall_ms = stall_ms
        self._nearest_m = math.inf
        self.deadline_ms = now_ms + stall_ms
        self._heard_ms: int | None = None
        if pose is not None:
            self._nearest_m = self._distance_m(pose)

    def take(self, pose: PoseReported, now_ms: int) -> None:
        distance_m = self._distance_m(pose)
        self._heard_ms = now_ms
        if distance_m <= self._nearest_m - PROGRESS_M:
            self._nearest_m = distance_m
            self.deadline_ms = now_ms + self._stall_ms

    def why(self) -> str:
        if self._heard_ms is None or self._heard_ms + self._stall_ms <= self.deadline_ms:
            return f"stalled: no pose of the vehicle was heard for {self._stall_ms / 1000:g} s"
        return f"stalled: not {PROGRESS_M:g} m nearer within {self._stall_ms / 1000:g} s, {self._nearest_m:.1f} m to go"

    def _distance_m(self, pose: PoseReported) -> float:
        return math.hypot(self._goal_m[0] - pose.north_m, self._goal_m[1] - pose.east_m)
