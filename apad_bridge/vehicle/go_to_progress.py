"""The stall watch of a go-to, because vehicles do not report when they are stuck."""

from __future__ import annotations

import math

from apad_bridge.vehicle.commands import PoseReported

PROGRESS_M = 0.5
STALL_S = 60.0


class GoToProgress:
    """Watches a go-to, which is stalled at `deadline_ms`: `stall_ms` after its last progress of `PROGRESS_M`.

    It counts from the vehicle's acceptance, `begin`. An order that is not accepted within `stall_ms` has stalled too.
    """

    def __init__(
        self, north_m: float, east_m: float, stall_ms: int, now_ms: int, pose: PoseReported | None
    ) -> None:
        self._goal_m = (north_m, east_m)
        self._stall_ms = stall_ms
        self._pose_ms: int | None = None
        self.begin(pose, now_ms)
        self._is_accepted = False

    def begin(self, pose: PoseReported | None, now_ms: int) -> None:
        """The vehicle has accepted the order, at this pose."""
        self._is_accepted = True
        self._nearest_m = math.inf if pose is None else self._distance_m(pose)
        self.deadline_ms = now_ms + self._stall_ms

    def take(self, pose: PoseReported, now_ms: int) -> None:
        distance_m = self._distance_m(pose)
        self._pose_ms = now_ms
        if distance_m <= self._nearest_m - PROGRESS_M:
            self._nearest_m = distance_m
            self.deadline_ms = now_ms + self._stall_ms

    def stall_reason(self) -> str:
        if not self._is_accepted:
            return f"stalled: the vehicle did not accept the go-to within {self._stall_ms / 1000:g} s"
        if self._pose_ms is None or self._pose_ms + self._stall_ms <= self.deadline_ms:
            return f"stalled: the vehicle sent no pose for {self._stall_ms / 1000:g} s"
        return f"stalled: not {PROGRESS_M:g} m nearer within {self._stall_ms / 1000:g} s, {self._nearest_m:.1f} m to go"

    def _distance_m(self, pose: PoseReported) -> float:
        return math.hypot(self._goal_m[0] - pose.north_m, self._goal_m[1] - pose.east_m)
