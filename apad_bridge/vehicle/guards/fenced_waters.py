"""Waters inside a fence and outside keep-out zones, in local NED metres.

waters = FencedWaters(Fence(corners, keep_out), clearance_m=2.0)
waters.fault_of_way((0.0, 0.0), (30.0, 5.0))      # "" or the reason
"""

from __future__ import annotations

import math

import shapely
import shapely.ops
from shapely.geometry import LineString, Polygon
from shapely.geometry import Point as PlanePoint

from apad_bridge.scenario.area.fence import Fence
from apad_bridge.vehicle.guards.guarded_orders import Point

_EPSILON_M = 1e-6
_FAR_M = 1000.0
"""A drift is followed so far."""


class FencedWaters:
    """Waters inside a fence and outside its keep-out zones.

    A goal keeps `clearance_m` to the edge, and so does the whole way. A way that begins nearer to the edge may not come
    nearer still. ValueError when nothing is left of the waters.
    """

    def __init__(self, fence: Fence, clearance_m: float) -> None:
        self._fence = Polygon(fence.corners)
        self._waters = fence.waters()
        self._edge = self._waters.boundary
        self._clear = self._waters.buffer(-clearance_m)
        self._clearance_m = clearance_m
        if self._clear.is_empty:
            raise ValueError(f"no place keeps {clearance_m:g} m to the fence and the keep-out zones")
        shapely.prepare(self._waters)
        shapely.prepare(self._edge)

    def fault_of_place(self, place_m: Point) -> str:
        place = PlanePoint(place_m)
        if self._waters.covers(place):
            return ""
        if self._fence.covers(place):
            return f"{_text(place_m)} lies in a keep-out zone"
        return f"{_text(place_m)} lies {self._fence.distance(place):.1f} m outside the fence"

    def fault_of_way(self, start_m: Point, goal_m: Point) -> str:
        if fault := self.fault_of_place(start_m):
            return f"the way begins where the aPad may not be: {fault}"
        if fault := self.fault_of_place(goal_m):
            return f"the goal {fault}"
        way = LineString([start_m, goal_m])
        if not self._waters.covers(way):
            return self._crossing(way)
        if fault := self.fault_of_room(goal_m, self._clearance_m):
            return f"the goal {fault}"
        least_m = min(self._clearance_m, self._edge.distance(PlanePoint(start_m)))
        if (way_m := self._edge.distance(way)) < least_m - _EPSILON_M:
            return f"the way passes {way_m:.1f} m from the fence or a keep-out zone: the least is {self._clearance_m:g} m"
        return ""

    def _crossing(self, way: LineString) -> str:
        """The edge that a way crosses first, and where."""
        beyond = shapely.get_coordinates(way.difference(self._waters))
        at = way.interpolate(min(way.project(PlanePoint(it)) for it in beyond))
        leaves_fence = self._fence.exterior.distance(at) < _EPSILON_M
        edge = "the fence" if leaves_fence else "a keep-out zone"
        return f"the way crosses {edge} at {_text((at.x, at.y))}, and the aPad goes straight"

    def fault_of_room(self, place_m: Point, room_m: float) -> str:
        if fault := self.fault_of_place(place_m):
            return fault
        edge_m = self._edge.distance(PlanePoint(place_m))
        if edge_m >= room_m - _EPSILON_M:
            return ""
        return f"{_text(place_m)} is {edge_m:.1f} m from the fence or a keep-out zone: the least is {room_m:.1f} m"

    def nearest_inside(self, place_m: Point) -> Point | None:
        nearest = shapely.ops.nearest_points(self._clear, PlanePoint(place_m))[0]
        return nearest.x, nearest.y

    def way_back(self, place_m: Point, most_m: float) -> tuple[Point, str]:
        edge = shapely.ops.nearest_points(self._waters, PlanePoint(place_m))[0]
        clear = shapely.ops.nearest_points(self._clear, PlanePoint(place_m))[0]
        inside_m = (clear.x, clear.y)
        if (way_m := math.dist(place_m, inside_m)) > most_m:
            # Short of all the clearance, but inside: the next way may not come nearer to the edge still.
            inside_m = _beyond(place_m, (edge.x, edge.y), most_m)
            if not self._waters.covers(PlanePoint(inside_m)):
                return (
                    inside_m,
                    f"the way back is {way_m:.1f} m long, the longest is {most_m:g} m: take it by hand",
                )
        if self._fence.difference(self._waters).intersects(LineString([place_m, inside_m])):
            return inside_m, "the way back crosses a keep-out zone: take it by hand"
        return inside_m, ""

    def way_out_m(self, place_m: Point, towards: Point) -> float | None:
        goal_m = _beyond(place_m, (place_m[0] + towards[0], place_m[1] + towards[1]), _FAR_M)
        crossing = LineString([place_m, goal_m]).intersection(self._edge)
        return None if crossing.is_empty else float(crossing.distance(PlanePoint(place_m)))


def _beyond(start_m: Point, through_m: Point, way_m: float) -> Point:
    """The place at the end of a straight way of this length from `start_m` through another place."""
    length_m = math.dist(start_m, through_m)
    if length_m == 0.0:
        return start_m
    return (
        start_m[0] + (through_m[0] - start_m[0]) * way_m / length_m,
        start_m[1] + (through_m[1] - start_m[1]) * way_m / length_m,
    )


def _text(place_m: Point) -> str:
    return f"({place_m[0]:.1f} m north, {place_m[1]:.1f} m east)"
