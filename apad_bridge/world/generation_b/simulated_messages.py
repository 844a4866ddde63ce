"""Messages of the simulated aPad of generation B, without ROS: requests of any origin as orders, and what it publishes.

Stamps are mission milliseconds.

The simulated vehicle moves alike in all directions, straight to its goal. So it takes place, speed and victory
radius of a go-to, and ignores the enabled axes, full actuation, depth, altitude, and the topics for references of
heading or speed.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

from apad_bridge.vehicle.commands import GoTo, Hold
from apad_bridge.vehicle.generation_b.messages import (
    Arm,
    DockingOrder,
    PrimitiveStatus,
)
from apad_bridge.world.apad.kinematics import Pose
from apad_bridge.world.simulated_stack import PosePublished

SIMPLE_VICTORY_RADIUS_M = 1.5

_DOCKING = DockingOrder(True, 0, 0.2, 0.3, 0.15, 0.2)
"""A simple docking names no rates. Assumed, because the laboratory's own are not public."""


def go_to(request: Any) -> GoTo:
    """The primitive `go2point`."""
    return GoTo(0, request.point.x, request.point.y, request.speed, request.victory_radius)


def position(request: Any) -> Hold:
    """The primitive `dynamic_positioning`."""
    return Hold(0, request.north, request.east, request.heading if request.heading_enable else None)


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


def simple_go_to(request: Any) -> GoTo:
    """The service `commander/go2point`."""
    return GoTo(0, request.point.x, request.point.y, request.speed, SIMPLE_VICTORY_RADIUS_M)


def simple_docking(request: Any) -> DockingOrder:
    """The service `commander/docking`."""
    return replace(_DOCKING, docks=request.action, dock_index=request.slot)


def goal(wanted: Any) -> GoTo:
    """A goal of the action `go2point`: to T2, in the local frame whatever its header names.

    The function ignores T1, where the line to be followed begins, because this vehicle goes straight from
    where it is. It ignores `subtype` and `heading` (under- or fully actuated, with or without a heading),
    because the vehicle moves in all directions and turns its bow towards T2. It ignores `ref_type` and
    `topics`, because nobody publishes references here and the goal's own speed holds.
    """
    return GoTo(0, wanted.T2.point.x, wanted.T2.point.y, wanted.speed, wanted.victory_radius)


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
    order: GoTo


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
