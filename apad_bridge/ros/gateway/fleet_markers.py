"""Draws the markers of a fleet and its aPad, for RViz and Foxglove, and deletes those of aMussels that left."""

from __future__ import annotations

from collections.abc import Iterable

from visualization_msgs.msg import Marker

from apad_bridge.ros.gateway import standard_messages as make
from apad_bridge.ros_names.frames import enu, yaw
from apad_bridge.supervisor.core import Supervisor


class FleetMarkers:
    """RViz keeps a marker until its deletion, so each picture begins with the deletion of all markers of its topic.

    A reader that loses the one deletion of a single marker would keep a ghost. Readers apply an array as one change, so
    nothing flickers. A lifetime would empty screens where mission time goes on and its supervisor does not.
    """

    def __init__(self, agent_ids: Iterable[int], world: str, ball_m: float) -> None:
        """`world` is the frame of all markers, `ball_m` the diameter of an aMussel's ball."""
        self._ids = frozenset(agent_ids)
        self._world = world
        self._ball_m = ball_m

    def draw(self, supervisor: Supervisor, now_ms: int) -> list[Marker]:
        """The whole picture, which does not depend on the one before."""
        return [self._clearing(now_ms), *self._shown(supervisor, now_ms)]

    def _shown(self, supervisor: Supervisor, now_ms: int) -> list[Marker]:
        # Each aPad draws the aMussels that it serves: one handed on is drawn by the aPad that serves it now.
        allocation, pose = supervisor.allocation, supervisor.pose
        ids = self._ids | allocation.served_for_others
        rows = {it: dock_index for dock_index, it in enumerate(supervisor.mission.docks) if it is not None}
        shown = [
            marker
            for it in allocation.all()
            if it.agent_id in ids
            for marker in make.agent_markers(it, now_ms, self._world, self._ball_m, rows.get(it.agent_id, 0))
        ]
        if pose is not None:
            at, attitude = enu(pose.north_m, pose.east_m), yaw(pose.heading_rad)
            shown.append(make.apad_marker(now_ms, self._world, at, attitude, self._ball_m))
        return shown

    def _clearing(self, now_ms: int) -> Marker:
        marker = Marker(header=make.header(now_ms, self._world), action=Marker.DELETEALL)
        marker.pose.orientation.w = 1.0  # all 0 is no attitude, and readers complain of it
        return marker
