"""Waters that a vehicle may use, in local NED metres."""

from __future__ import annotations

from typing import Protocol

from apad_bridge.vehicle.guards.guarded_orders import Point


class Waters(Protocol):
    """Checks places and ways; each fault is a reason for people, empty for none."""

    def fault_of_place(self, place_m: Point) -> str:
        """Outside the fence or in a keep-out zone, whatever the clearance."""

    def fault_of_way(self, start_m: Point, goal_m: Point) -> str:
        """The straight way leaves the waters, or comes too near to their edge."""

    def fault_of_room(self, place_m: Point, room_m: float) -> str:
        """The edge is nearer to the place than `room_m`."""

    def nearest_inside(self, place_m: Point) -> Point | None:
        """The nearest place with all the clearance; None where there is none."""

    def way_back(self, place_m: Point, most_m: float) -> tuple[Point, str]:
        """The nearest place inside, and the reason why the straight way there must not be taken; empty for none."""

    def way_out_m(self, place_m: Point, towards: Point) -> float | None:
        """The distance to the edge of the waters in this direction; None where there is none within a kilometre."""


class OpenWaters:
    """Waters without a fence: no place and no way has a fault."""

    def fault_of_place(self, place_m: Point) -> str:
        return ""

    def fault_of_way(self, start_m: Point, goal_m: Point) -> str:
        return ""

    def fault_of_room(self, place_m: Point, room_m: float) -> str:
        return ""

    def nearest_inside(self, place_m: Point) -> Point | None:
        return None

    def way_back(self, place_m: Point, most_m: float) -> tuple[Point, str]:
        return place_m, "these waters have no fence"

    def way_out_m(self, place_m: Point, towards: Point) -> float | None:
        return None
