"""Tasks of a generation B aPad (go-to, hold, visual docking) and the watch that follows their status topics.

The status topics name no order and may be silent. Nothing reports whether the vehicle holds a position,
except the position itself.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from apad_bridge.scenario.blocks.mission_options import Servo
from apad_bridge.vehicle.commands import CloseDock, GoTo, Hold, OpenDock, PoseReported, VehicleCommand
from apad_bridge.vehicle.generation_b.messages import (
    DockingOrder,
    PrimitiveStatus,
    ServiceOrder,
    dock_direction_rad,
)
from apad_bridge.vehicle.vehicle_link import Cleared

GRACE_MS = 3_000
"""A vehicle that took an order and does not run it for so long has dropped it."""
NEAR_M = 1.0
"""Beyond the victory radius. Farther away than that, a reported end of a go-to is not believed."""
SILENT_MS = 3_000
"""So long in the victory radius, without a message on `goto_status`, counts as arrival."""
ASTRAY_M = 3.0
"""A vehicle that should hold and is this far away does not hold."""
ASTRAY_MS = 10_000
"""The shortest time between two orders of the same hold."""
STAND_OFF_M = 2.0
"""From here the camera can see an aMussel; it cannot see an aMussel against the hull."""
STAND_OFF_MS = 30_000
"""The longest time for standing off; then the docking begins from the vehicle's present position."""
_THERE_M, _THERE_RAD = 0.3, 0.2
_FAR_M = 10.0
"""Only a goal of the last go-to within this distance counts as the aMussel's place."""


class StatusWatch:
    """Follows a status topic for one order, from its sending on; messages about an earlier order may still come."""

    def __init__(self) -> None:
        self._is_running = False
        self._idle_since_ms: int | None = None
        self._last: PrimitiveStatus | None = None
        self._ran_ms: int | None = None
        """The time of the first RUNNING after the answer."""
        self._is_preempted = False
        self.is_replaced = False
        """The order ran for `GRACE_MS` or longer, was pre-empted, and another one runs, which nobody here sent."""

    def receive(self, status: PrimitiveStatus, at_ms: int, *, answered: bool, plausible: bool) -> bool:
        """True when the order is done. `answered`: the service took it; `plausible`: the position looks done."""
        self._last = status
        if status is PrimitiveStatus.RUNNING:
            self._is_running, self._idle_since_ms = True, None
            self.is_replaced = self.is_replaced or self._is_preempted
            if answered and self._ran_ms is None:
                self._ran_ms = at_ms
            return False
        if not answered:
            self._is_running = False
            return False
        if status is PrimitiveStatus.PREEMPTED and self._ran_ms is not None:
            # The end of an earlier order of ours comes with the begin of this one, and not so much later.
            self._is_preempted = at_ms - self._ran_ms >= GRACE_MS
        if status is PrimitiveStatus.DONE and (self._is_running or plausible):
            return True
        self._is_running = False
        if self._idle_since_ms is None:
            self._idle_since_ms = at_ms
        return False

    @property
    def has_status(self) -> bool:
        return self._last is not None

    def why_lost(self, now_ms: int) -> str | None:
        """The reason to believe that the vehicle no longer runs the order; None while it may."""
        if self._idle_since_ms is None or now_ms - self._idle_since_ms < GRACE_MS or self._last is None:
            return None
        return f"its status says {self._last.name}"


class GoToTask:
    """One go-to, from its order to its end."""

    def __init__(self, command: GoTo) -> None:
        self.command = command
        self._watch = StatusWatch()
        self._near_since_ms: int | None = None

    def distance_m(self, pose: PoseReported | None) -> float:
        if pose is None:
            return math.inf
        return math.hypot(self.command.north_m - pose.north_m, self.command.east_m - pose.east_m)

    def receive(
        self, status: PrimitiveStatus, at_ms: int, pose: PoseReported | None, *, answered: bool
    ) -> bool:
        """True when the vehicle reports the end; `is_near` tells whether to believe it."""
        return self._watch.receive(status, at_ms, answered=answered, plausible=self.is_near(pose))

    @property
    def is_replaced(self) -> bool:
        """Another client's go-to runs in its place."""
        return self._watch.is_replaced

    def is_near(self, pose: PoseReported | None) -> bool:
        return self.distance_m(pose) <= self.command.victory_radius_m + NEAR_M

    def why_lost(self, now_ms: int) -> str | None:
        why = self._watch.why_lost(now_ms)
        return None if why is None else f"the aPad ended the go-to by itself: {why}"

    def has_arrived_unreported(self, pose: PoseReported | None, now_ms: int) -> bool:
        """The aPad has been at the goal for a while, and its status topic has been silent all along."""
        if self._watch.has_status or self.distance_m(pose) > self.command.victory_radius_m:
            self._near_since_ms = None
        elif self._near_since_ms is None:
            self._near_since_ms = now_ms
        return self._near_since_ms is not None and now_ms - self._near_since_ms >= SILENT_MS


@dataclass(slots=True)
class HoldTask:
    """A position that the aPad was ordered to hold.

    Other parties' orders that pre-empt the hold show on the status topics: a go-to on `goto_status`, a
    docking on `docking_status`. The bridge does not fight them: it lets them end and then asks for the hold
    again.
    """

    command: Hold
    ordered_ms: int
    """The time of the order; from the service's answer on, the time of that."""
    is_quiet: bool = False
    """After the order was taken, `goto_status` stated that no go-to runs: a later go-to is another party's."""
    is_lost: bool = False
    """An order of another party has pre-empted the hold."""
    others_since_ms: int | None = None
    """The time of the first RUNNING of another party's go-to, until its end."""

    def receive_goto_status(self, status: PrimitiveStatus, at_ms: int, *, answered: bool) -> bool:
        """Takes a message of `goto_status`; True when it shows a new go-to of another party.

        Late messages about our own go-to come before the message that it is over.
        """
        if status is not PrimitiveStatus.RUNNING:
            self.is_quiet = self.is_quiet or answered
            self.others_since_ms = None
            return False
        is_new = self.is_quiet and self.others_since_ms is None
        if is_new:
            self.is_lost, self.others_since_ms = True, at_ms
        return is_new

    def is_left_alone(self, now_ms: int, timeout_s: float) -> bool:
        return self.others_since_ms is not None and now_ms - self.others_since_ms < timeout_s * 1000

    def is_astray(self, pose: PoseReported | None, now_ms: int) -> bool:
        if now_ms - self.ordered_ms < ASTRAY_MS:
            return False
        if self.is_lost or pose is None:
            return self.is_lost
        away_m = math.hypot(self.command.north_m - pose.north_m, self.command.east_m - pose.east_m)
        return away_m > ASTRAY_M


class ServoTask:
    """A docking or undocking by the vehicle's own visual servoing: stand off, order, watch, give up in time.

    `goal_m` is the aMussel's believed place: the last go-to's goal.
    """

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
        """An undocking whose arm stands open, while the vehicle still pulls back."""
        self.next_command: Cleared[VehicleCommand] | None = None
        """A command that came meanwhile and waits, because it would cut the pulling back short."""
        self._config = config
        self._watch = StatusWatch()
        self._stand: Hold | None = None
        self._stand_until_ms = now_ms + STAND_OFF_MS
        if isinstance(command, CloseDock) and pose is not None and goal_m is not None:
            self._stand = _stand_off(goal_m, pose, command.dock_index)

    @property
    def first_order(self) -> ServiceOrder:
        return self._stand if self._stand is not None else self._docking_order()

    def next_order(
        self, pose: PoseReported | None, answered_ms: int | None, now_ms: int
    ) -> ServiceOrder | None:
        """The docking itself, when the vehicle has stood off or its time for this is over."""
        if (stand := self._stand) is None:
            return None
        there = pose is not None and answered_ms is not None and _is_there(stand, pose)
        if not there and now_ms < self._stand_until_ms:
            return None
        self._stand = None
        return self._docking_order()

    def receive(self, status: PrimitiveStatus, at_ms: int, *, answered: bool) -> bool:
        """True when the vehicle is done. Messages before the order to dock belong to an earlier docking."""
        if self._stand is not None:
            return False
        return self._watch.receive(status, at_ms, answered=answered, plausible=False)

    def why_over(self, answered_ms: int | None, now_ms: int) -> str | None:
        """The reason to give the docking up; None while it may go on."""
        if self._stand is not None or answered_ms is None:
            return None
        if (why := self._watch.why_lost(now_ms)) is not None:
            return f"the aPad ended its docking by itself: {why}"
        if now_ms - answered_ms >= self._config.search_s * 1000:
            return f"the aPad's docking did not come to an end within {self._config.search_s:g} s"
        return None

    def _docking_order(self) -> DockingOrder:
        config, manoeuvre = self._config, self.command.manoeuvre
        return DockingOrder(
            docks=isinstance(self.command, CloseDock),
            dock_index=self.command.dock_index,
            search_yaw_rate_rad_s=config.search_yaw_rate_rad_s,
            max_yaw_rate_rad_s=config.max_yaw_rate_rad_s
            if manoeuvre.yaw_rate_rad_s is None
            else manoeuvre.yaw_rate_rad_s,
            max_surge_m_s=config.max_surge_m_s if manoeuvre.surge_m_s is None else manoeuvre.surge_m_s,
            surge_stdev=config.surge_stdev,
            agent_id=self.command.agent_id,
        )


def _stand_off(goal_m: tuple[float, float], pose: PoseReported, dock_index: int) -> Hold | None:
    """The waiting place: off the aMussel, on the vehicle's side, dock towards it. None for a vehicle elsewhere."""
    north_m, east_m = pose.north_m - goal_m[0], pose.east_m - goal_m[1]
    distance_m = math.hypot(north_m, east_m)
    if distance_m > _FAR_M:
        return None
    away_rad = math.atan2(east_m, north_m) if distance_m > 0.05 else pose.heading_rad + math.pi
    heading_rad = math.remainder(away_rad + math.pi - dock_direction_rad(dock_index), math.tau)
    return Hold(
        0,
        goal_m[0] + STAND_OFF_M * math.cos(away_rad),
        goal_m[1] + STAND_OFF_M * math.sin(away_rad),
        heading_rad,
    )


def _is_there(stand: Hold, pose: PoseReported) -> bool:
    away_m = math.hypot(stand.north_m - pose.north_m, stand.east_m - pose.east_m)
    heading_rad = stand.heading_rad if stand.heading_rad is not None else pose.heading_rad
    off_rad = abs(math.remainder(heading_rad - pose.heading_rad, math.tau))
    return away_m < _THERE_M and off_rad < _THERE_RAD
