"""What is sent to, and heard from, an aPad of generation B, freed of ROS. Stamps are mission milliseconds.

Its primitives are services that answer at once; how they end is told by status topics, and by an event of one text.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import IntEnum, StrEnum

from apad_bridge.vehicle.stack_messages import BatteryHeard, PoseHeard, StateHeard

PRIMITIVE_FINISHED = "/PRIMITIVE_FINISHED"
CAMERA_SERVO = (0.1, 0.46, 0.75, 1.0)
"""What `kinect_out` says while the camera looks towards each slot."""
PULL_BACK_MS = 8_000
PULL_BACK_M_S = 0.3
SERVO_MS = 27_000
"""So long docking and undocking stand still in their own callback, before anything else, while the boat drifts."""
DETECTION_MS = 1_000
"""A detection older than this is none, and the primitive searches."""


def slot_direction_rad(slot: int) -> float:
    """Where a slot is, clockwise from the bow."""
    return math.remainder(slot * math.pi / 2, math.tau)


class Status(IntEnum):
    """Of `goto_status` and `docking_status`."""

    IDLE = 0
    RUNNING = 1
    PREEMPTED = 2
    DONE = 3


class Primitive(StrEnum):
    """The services below `commander/primitive`, by their names."""

    GO_TO = "go2point"
    POSITION = "dynamic_positioning"
    DOCKING = "docking"


@dataclass(frozen=True, slots=True)
class GoToOrder:
    north_m: float
    east_m: float
    speed_m_s: float
    victory_radius_m: float


@dataclass(frozen=True, slots=True)
class PositionOrder:
    """Hold there until something else is asked; without a heading, any will do."""

    north_m: float
    east_m: float
    heading_rad: float | None = None


@dataclass(frozen=True, slots=True)
class DockingOrder:
    """Dock or, without `docks`, undock by the vehicle's own eyes. It names a slot and no aMussel."""

    docks: bool
    slot: int
    search_yaw_rate_rad_s: float
    max_yaw_rate_rad_s: float
    max_surge_m_s: float
    surge_stdev: float


Order = GoToOrder | PositionOrder | DockingOrder


@dataclass(frozen=True, slots=True)
class Call:
    """An order under a number that its answer comes back with."""

    number: int
    order: Order


@dataclass(frozen=True, slots=True)
class Arm:
    """`dock_out`: which arms stand open, by slot."""

    is_open: tuple[bool, bool, bool, bool]


@dataclass(frozen=True, slots=True)
class Answered:
    """A service's answer: it only says that the order was taken, or why not."""

    at_ms: int
    number: int
    refused: str | None


@dataclass(frozen=True, slots=True)
class StatusHeard:
    """`goto_status`, or with `docking` the other one."""

    at_ms: int
    docking: bool
    status: Status


@dataclass(frozen=True, slots=True)
class FinishedHeard:
    """Some primitive ended: its controllers are off now."""

    at_ms: int


@dataclass(frozen=True, slots=True)
class PilotHeard:
    """`manual`: whether a person steers."""

    at_ms: int
    steers: bool


@dataclass(frozen=True, slots=True)
class ArmHeard:
    at_ms: int
    slot: int | None
    """The slot whose arm stands open; None while none does."""


Heard = PoseHeard | StateHeard | BatteryHeard | Answered | StatusHeard | FinishedHeard | PilotHeard | ArmHeard
