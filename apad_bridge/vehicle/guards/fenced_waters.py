"""Waters inside a fence and outside keep-out zones, in local NED metres.

waters = FencedWaters(Fence(corners, keep_out), clearance_m=2.0)
waters.fault_of_way((0.0, 0.0), (30.0, 5.0))      # "" or the reason
"""

from __future__ import annotations

import shapely
import shapely.ops
from shapely.geometry import LineString, Polygon
from shapely.geometry import Point as PlanePoint

from apad_bridge.scenario.fence import Fence
from apad_bridge.vehicle.guards.orders import Point

_EPSILON_M = 1e-6


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
            return "the way crosses the fence or a keep-out zone"
        if fault := self.fault_of_room(goal_m, self._clearance_m):
            return f"the goal {fault}"
        least_m = min(self._clearance_m, self._edge.distance(PlanePoint(start_m)))
        way_m = self._edge.distance(way)
        if way_m < least_m - _EPSILON_M:
            return f"the way passes {way_m:.1f} m from the fence or a keep-out zone: the least is {self._clearance_m:g} m"
        return ""

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


def _text(place_m: Point) -> str:
    return f"({place_m[0]:.1f} m north, {place_m[1]:.1f} m east)"
