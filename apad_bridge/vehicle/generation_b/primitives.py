"""One go-to of generation B, from its order to what became of it: its status topic names no order, and may be silent.

A docking or undocking by the vehicle's own visual servoing: stood off, ordered, watched, given up in time.

A position that an aPad of generation B was told to hold: nothing says whether it does, but where it is.

What pre-empts a hold past us shows itself, though: a go-to by `goto_status`, a docking by `docking_status`. Whoever ordered
it is not fought: it is let end, and the hold told again after it.

What became of an order, made out of a status topic of generation B: its words name no order.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from apad_bridge.scenario.schema import Servo
from apad_bridge.vehicle.commands import CloseDock, GoTo, Hold, OpenDock, PoseReported, VehicleCommand
from apad_bridge.vehicle.generation_b.messages import (
    DockingOrder,
    GoToOrder,
    Order,
    PositionOrder,
    Status,
    dock_direction_rad,
)

GRACE_MS = 3_000
"""A vehicle that took an order and does not run it for so long has dropped it."""


class StatusWatch:
    """Of one order, from when it was sent. Words about an earlier order are still on their way then."""

    def __init__(self) -> None:
        self._is_running = False
        self._idle_since_ms: int | None = None
        self._last: Status | None = None

    def hear(self, status: Status, at_ms: int, *, answered: bool, plausible: bool) -> bool:
        """Whether the order is done. `answered`: the service took it; `plausible`: it looks done from where the aPad is."""
        self._last = status
        if status is Status.RUNNING:
            self._is_running, self._idle_since_ms = True, None
            return False
        if not answered:
            self._is_running = False
            return False
        if status is Status.DONE and (self._is_running or plausible):
            return True
        self._is_running = False
        if self._idle_since_ms is None:
            self._idle_since_ms = at_ms
        return False

    @property
    def was_heard(self) -> bool:
        return self._last is not None

    def why_lost(self, now_ms: int) -> str | None:
        """Why the vehicle is believed to run the order no more; None while it may."""
        if self._idle_since_ms is None or now_ms - self._idle_since_ms < GRACE_MS or self._last is None:
            return None
        return f"its status says {self._last.name}"


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
            self._stand = _stand_off(goal_m, pose, command.dock_index)

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
            self.command.dock_index,
            config.search_yaw_rate_rad_s,
            config.max_yaw_rate_rad_s if told.yaw_rate_rad_s is None else told.yaw_rate_rad_s,
            config.max_surge_m_s if told.surge_m_s is None else told.surge_m_s,
            config.surge_stdev,
        )


def _stand_off(goal_m: tuple[float, float], pose: PoseReported, dock_index: int) -> PositionOrder | None:
    """Where to wait: off the aMussel, on the vehicle's side, with the slot towards it. None if it is elsewhere."""
    north_m, east_m = pose.north_m - goal_m[0], pose.east_m - goal_m[1]
    distance_m = math.hypot(north_m, east_m)
    if distance_m > _FAR_M:
        return None
    away_rad = math.atan2(east_m, north_m) if distance_m > 0.05 else pose.heading_rad + math.pi
    heading_rad = math.remainder(away_rad + math.pi - dock_direction_rad(dock_index), math.tau)
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
