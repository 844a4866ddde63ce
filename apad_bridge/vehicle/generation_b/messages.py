"""ROS-free messages of generation B: orders, the aPad's answers, and the simulated aPad's messages.

The stack's primitives are services that answer at once. Status topics, and an event of one text, tell how
they end. Requests of any origin become orders here, by their fields alone. Stamps are mission milliseconds.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from enum import IntEnum, StrEnum
from typing import Any

from apad_bridge.vehicle.commands import OrderCut, VehicleCommand
from apad_bridge.vehicle.link import Cleared
from apad_bridge.vehicle.simulated.kinematics import Pose
from apad_bridge.vehicle.stack_messages import BatteryReceived, PosePublished, PoseReceived, StateRefReceived

PRIMITIVE_FINISHED = "/PRIMITIVE_FINISHED"
CAMERA_SERVO = (0.1, 0.46, 0.75, 1.0)
"""The values of `kinect_out` while the camera looks towards each dock."""
PULL_BACK_MS = 8_000
PULL_BACK_M_S = 0.3
SERVO_MS = 27_000
"""Docking and undocking first stand still for so long in their own callback, while the boat drifts."""
DETECTION_MS = 1_000
"""The primitive ignores older detections and searches."""
SIMPLE_VICTORY_RADIUS_M = 1.5


def dock_direction_rad(dock_index: int) -> float:
    """The direction of a dock, clockwise from the bow."""
    return math.remainder(dock_index * math.pi / 2, math.tau)


class PrimitiveStatus(IntEnum):
    """Values of `goto_status` and `docking_status`."""

    IDLE = 0
    RUNNING = 1
    PREEMPTED = 2
    DONE = 3


class PrimitiveName(StrEnum):
    """The services below `commander/primitive`, by their names."""

    GO_TO = "go2point"
    POSITION = "dynamic_positioning"
    DOCKING = "docking"


# Orders.


@dataclass(frozen=True, slots=True)
class GoToOrder:
    north_m: float
    east_m: float
    speed_m_s: float
    victory_radius_m: float


@dataclass(frozen=True, slots=True)
class PositionOrder:
    """Hold a position until the next order; no heading means any heading."""

    north_m: float
    east_m: float
    heading_rad: float | None = None
    pre_empts: bool = field(default=False, compare=False)
    """A stop's: it takes the vehicle from every other client."""


@dataclass(frozen=True, slots=True)
class DockingOrder:
    """Dock or, without `docks`, undock by visual servoing. The order names a dock and no aMussel."""

    docks: bool
    dock_index: int
    search_yaw_rate_rad_s: float
    max_yaw_rate_rad_s: float
    max_surge_m_s: float
    surge_stdev: float
    agent_id: int = field(default=0, compare=False)
    """The aMussel in an order of ours, for the guards; the message has no field for it."""


@dataclass(frozen=True, slots=True)
class StopOrder:
    """`commander/stop_mission`: the primitive ends, and with it the controllers."""


ServiceOrder = GoToOrder | PositionOrder | DockingOrder | StopOrder


@dataclass(frozen=True, slots=True)
class NumberedOrder:
    """An order under a number, which its answer repeats."""

    number: int
    order: ServiceOrder
    before: Cleared[VehicleCommand]
    """The command for which it goes out, as the gate let it out."""


# Messages from the aPad.


@dataclass(frozen=True, slots=True)
class Go2pointGoalSeen:
    """A go-to on its way to the action server `go2point`, by whichever service or client, and the node that sent it."""

    at_ms: int
    north_m: float
    east_m: float
    client: str


@dataclass(frozen=True, slots=True)
class ServiceAnswered:
    """A service's answer: it took the order, or `refused` states why not."""

    at_ms: int
    number: int
    refused: str | None


@dataclass(frozen=True, slots=True)
class StatusReceived:
    """`goto_status`, or `docking_status` with `docking`."""

    at_ms: int
    docking: bool
    status: PrimitiveStatus


@dataclass(frozen=True, slots=True)
class FinishedReceived:
    """Some primitive ended: its controllers are off now."""

    at_ms: int


@dataclass(frozen=True, slots=True)
class ManualReceived:
    """`manual`: a person steers, or no longer does. None: the node that published it has left the graph."""

    at_ms: int
    steers: bool | None


@dataclass(frozen=True, slots=True)
class ArmReceived:
    at_ms: int
    dock_index: int | None
    """The dock whose arm stands open; None while all arms are closed."""


Received = (
    PoseReceived
    | StateRefReceived
    | BatteryReceived
    | ServiceAnswered
    | OrderCut
    | StatusReceived
    | FinishedReceived
    | ManualReceived
    | ArmReceived
    | Go2pointGoalSeen
)


# Requests to the simulated aPad, as orders.
#
# The simulated vehicle moves alike in all directions, straight to its goal. So it takes place, speed and victory
# radius of a go-to, and ignores the enabled axes, full actuation, depth, altitude, and the topics for references of
# heading or speed.

_DOCKING = DockingOrder(True, 0, 0.2, 0.3, 0.15, 0.2)
"""A simple docking names no rates. Assumed, because the laboratory's own are not public."""


def go_to(request: Any) -> GoToOrder:
    """The primitive `go2point`."""
    return GoToOrder(request.point.x, request.point.y, request.speed, request.victory_radius)


def position(request: Any) -> PositionOrder:
    """The primitive `dynamic_positioning`."""
    return PositionOrder(request.north, request.east, request.heading if request.heading_enable else None)


def docking(request: Any) -> DockingOrder:
    """The primitive `docking`."""
    return DockingOrder(
        request.docking_action,
        request.docking_slot,
        request.search_yaw_rate,
        request.max_yaw_rate,
        request.max_surge_speed,
        request.surge_stdev,
    )


def simple_go_to(request: Any) -> GoToOrder:
    """The service `commander/go2point`."""
    return GoToOrder(request.point.x, request.point.y, request.speed, SIMPLE_VICTORY_RADIUS_M)


def simple_docking(request: Any) -> DockingOrder:
    """The service `commander/docking`."""
    return replace(_DOCKING, docks=request.action, dock_index=request.slot)


def goal(wanted: Any) -> GoToOrder:
    """A goal of the action `go2point`: to T2, in the local frame whatever its header names.

    The function ignores T1, where the line to be followed begins, because this vehicle goes straight from
    where it is. It ignores `subtype` and `heading` (under- or fully actuated, with or without a heading),
    because the vehicle moves in all directions and turns its bow towards T2. It ignores `ref_type` and
    `topics`, because nobody publishes references here and the goal's own speed holds.
    """
    return GoToOrder(wanted.T2.point.x, wanted.T2.point.y, wanted.speed, wanted.victory_radius)


# Messages that the simulated aPad publishes.


@dataclass(frozen=True, slots=True)
class Arm:
    """`dock_out`: the state of the arms, by dock index."""

    is_open: tuple[bool, ...]


def arms(opened: int | None) -> Arm:
    """All four arms, with the arm of dock `opened` open; a vehicle with fewer docks publishes four all the same."""
    return Arm(tuple(slot == opened for slot in range(len(CAMERA_SERVO))))


@dataclass(frozen=True, slots=True)
class BatteryPublished:
    at_ms: int
    percent: float


@dataclass(frozen=True, slots=True)
class StatusPublished:
    at_ms: int
    docking: bool
    status: PrimitiveStatus


@dataclass(frozen=True, slots=True)
class ArmPublished:
    at_ms: int
    arm: Arm


@dataclass(frozen=True, slots=True)
class CameraTurned:
    """`kinect_out`: the camera's servo, in [0, 1]."""

    at_ms: int
    servo: float


@dataclass(frozen=True, slots=True)
class Finished:
    """A primitive ended, whichever way."""

    at_ms: int


@dataclass(frozen=True, slots=True)
class GoToBegun:
    """A go-to began below the services, whoever ordered it and whichever way the order came."""

    at_ms: int
    order: GoToOrder


@dataclass(frozen=True, slots=True)
class GoToLeft:
    """The rest of the way: metres, and the direction clockwise from north."""

    at_ms: int
    distance_m: float
    bearing_rad: float


@dataclass(frozen=True, slots=True)
class GoToEnded:
    """`status` is DONE, PREEMPTED, or IDLE for an aborted go-to."""

    status: PrimitiveStatus
    pose: Pose
    left: GoToLeft


Published = (
    PosePublished
    | BatteryPublished
    | StatusPublished
    | ArmPublished
    | CameraTurned
    | Finished
    | GoToBegun
    | GoToLeft
    | GoToEnded
)
