"""A docking or undocking by the vehicle's own visual servoing: stood off, ordered, watched, given up in time."""

from __future__ import annotations

import math

from apad_bridge.ros.generation_b_status import StatusWatch
from apad_bridge.scenario.schema import Servo
from apad_bridge.vehicle.commands import CloseDock, OpenDock, PoseReported, VehicleCommand
from apad_bridge.vehicle.generation_b.messages import (
    DockingOrder,
    Order,
    PositionOrder,
    Status,
    slot_direction_rad,
)

STAND_OFF_M = 2.0
"""From here the camera can see an aMussel; one that lies against the hull it cannot."""
STAND_OFF_MS = 30_000
"""Standing off takes this long at most; then docking is tried from where the vehicle is."""
_THERE_M, _THERE_RAD = 0.3, 0.2
_FAR_M = 10.0
"""The last go-to's goal is taken for the aMussel's place only this near to it."""


class ServoDocking:
    """`goal_m` is where the aMussel was believed to be: the last go-to's goal."""

    def __init__(
        self,
        command: CloseDock | OpenDock,
        config: Servo,
        pose: PoseReported | None,
        goal_m: tuple[float, float] | None,
        now_ms: int,
    ) -> None:
        self.command = command
        self.has_let_go = False
        """Of an undocking: its arm stands open, and the vehicle still pulls back."""
        self.waits: VehicleCommand | None = None
        """What was commanded meanwhile: it would cut the pulling back short."""
        self._config = config
        self._watch = StatusWatch()
        self._stand: PositionOrder | None = None
        self._stand_until_ms = now_ms + STAND_OFF_MS
        if isinstance(command, CloseDock) and pose is not None and goal_m is not None:
            self._stand = _stand_off(goal_m, pose, command.slot)

    @property
    def first_order(self) -> Order:
        return self._stand if self._stand is not None else self._docking_order()

    def next_order(self, pose: PoseReported | None, answered_ms: int | None, now_ms: int) -> Order | None:
        """The docking itself, when the vehicle has stood off or this took too long."""
        stand = self._stand
        if stand is None:
            return None
        there = pose is not None and answered_ms is not None and _is_there(stand, pose)
        if not there and now_ms < self._stand_until_ms:
            return None
        self._stand = None
        return self._docking_order()

    def hear(self, status: Status, at_ms: int, *, answered: bool) -> bool:
        """Whether the vehicle has come to the end. Words before the docking is ordered are of an earlier one."""
        if self._stand is not None:
            return False
        return self._watch.hear(status, at_ms, answered=answered, plausible=False)

    def why_over(self, answered_ms: int | None, now_ms: int) -> str | None:
        """Why it is to be given up; None while it may go on."""
        if self._stand is not None or answered_ms is None:
            return None
        if (why := self._watch.why_lost(now_ms)) is not None:
            return f"the aPad ended its docking by itself: {why}"
        if now_ms - answered_ms >= self._config.search_s * 1000:
            return f"the aPad's docking did not come to an end within {self._config.search_s:g} s"
        return None

    def _docking_order(self) -> DockingOrder:
        config, told = self._config, self.command.manoeuvre
        return DockingOrder(
            isinstance(self.command, CloseDock),
            self.command.slot,
            config.search_yaw_rate_rad_s,
            config.max_yaw_rate_rad_s if told.yaw_rate_rad_s is None else told.yaw_rate_rad_s,
            config.max_surge_m_s if told.surge_m_s is None else told.surge_m_s,
            config.surge_stdev,
        )


def _stand_off(goal_m: tuple[float, float], pose: PoseReported, slot: int) -> PositionOrder | None:
    """Where to wait: off the aMussel, on the vehicle's side, with the slot towards it. None if it is elsewhere."""
    north_m, east_m = pose.north_m - goal_m[0], pose.east_m - goal_m[1]
    distance_m = math.hypot(north_m, east_m)
    if distance_m > _FAR_M:
        return None
    away_rad = math.atan2(east_m, north_m) if distance_m > 0.05 else pose.heading_rad + math.pi
    heading_rad = math.remainder(away_rad + math.pi - slot_direction_rad(slot), math.tau)
    return PositionOrder(
        goal_m[0] + STAND_OFF_M * math.cos(away_rad),
        goal_m[1] + STAND_OFF_M * math.sin(away_rad),
        heading_rad,
    )


def _is_there(stand: PositionOrder, pose: PoseReported) -> bool:
    away_m = math.hypot(stand.north_m - pose.north_m, stand.east_m - pose.east_m)
    heading_rad = stand.heading_rad if stand.heading_rad is not None else pose.heading_rad
    off_rad = abs(math.remainder(heading_rad - pose.heading_rad, math.tau))
    return away_m < _THERE_M and off_rad < _THERE_RAD
