"""What is asked of an aPad of generation B, by whichever road, as orders. Requests are met by their fields: no ROS in here.

The simulated vehicle moves alike in all directions, straight to where it shall be. So of a go-to it takes place, speed and
victory radius; which axes are enabled, whether it is fully actuated, depth, altitude, and topics to take heading or speed
from mean nothing to it.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from apad_bridge.vehicle.generation_b.messages import DockingOrder, GoToOrder, PositionOrder

SIMPLE_VICTORY_RADIUS_M = 1.5
_DOCKING = DockingOrder(True, 0, 0.2, 0.3, 0.15, 0.2)
"""A simple docking names no rates. Assumed, for the laboratory's own are not public."""


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
    return replace(_DOCKING, docks=request.action, slot=request.slot)


def goal(wanted: Any) -> GoToOrder:
    """A goal of the action `go2point`: to T2, in the local frame whatever its header names.

    T1, where the line to be followed begins, is not looked at: this vehicle goes straight from where it is. Neither are
    `subtype` and `heading` (under- or fully actuated, with or without a heading): it moves in all directions, and its bow
    turns towards T2. Nor are `ref_type` and `topics`: nobody publishes references here, and the goal's own speed holds.
    """
    return GoToOrder(wanted.T2.point.x, wanted.T2.point.y, wanted.speed, wanted.victory_radius)
