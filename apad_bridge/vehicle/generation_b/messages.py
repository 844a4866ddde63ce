"""ROS-free messages of generation B: orders, the aPad's answers, and the simulated aPad's messages.

The stack's primitives are services that answer at once. Status topics, and an event of one text, tell how
they end. Requests of any origin become orders here, by their fields alone. Stamps are mission milliseconds.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from enum import IntEnum, StrEnum

from apad_bridge.vehicle.commands import (
    GoalOfOthers,
    GoTo,
    Hold,
    OrderCut,
    PoseReported,
    Stop,
    VehicleCommand,
)
from apad_bridge.vehicle.stack_messages import BatteryReceived, StateRefReceived
from apad_bridge.vehicle.vehicle_link import Cleared

PRIMITIVE_FINISHED = "/PRIMITIVE_FINISHED"
CAMERA_SERVO = (0.1, 0.46, 0.75, 1.0)
"""The values of `kinect_out` while the camera looks towards each dock."""
PULL_BACK_MS = 8_000
PULL_BACK_M_S = 0.3
SERVO_MS = 27_000
"""Docking and undocking first stand still for so long in their own callback, while the boat drifts."""
DETECTION_MS = 1_000
"""The primitive ignores older detections and searches."""


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


ServiceOrder = GoTo | Hold | DockingOrder | Stop
"""On the wire none has a command's id, which is 0. A stop is `commander/stop_mission`: the primitive ends, and with it the
controllers."""


@dataclass(frozen=True, slots=True)
class NumberedOrder:
    """An order under a number, which its answer repeats."""

    number: int
    order: ServiceOrder
    before: Cleared[VehicleCommand]
    """The command for which it goes out, as the gate let it out."""


# Messages from the aPad.


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
class ManualReceived:
    """`manual`: a person steers, or no longer does. None: the node that published it has left the graph."""

    at_ms: int
    steers: bool | None


@dataclass(frozen=True, slots=True)
class ArmReceived:
    """The arm of this dock stands open."""

    at_ms: int
    dock_index: int


Received = (
    PoseReported
    | StateRefReceived
    | BatteryReceived
    | ServiceAnswered
    | OrderCut
    | StatusReceived
    | ManualReceived
    | ArmReceived
    | GoalOfOthers
)
"""A `GoalOfOthers` is any go-to on its way to the action server `go2point`, by whichever service or client; the core tells
ours apart."""


@dataclass(frozen=True, slots=True)
class Arm:
    """`dock_out`: the state of the arms, by dock index."""

    is_open: tuple[bool, ...]


def arms(opened: int | None) -> Arm:
    """All four arms, with the arm of dock `opened` open; a vehicle with fewer docks publishes four all the same."""
    return Arm(tuple(slot == opened for slot in range(len(CAMERA_SERVO))))
