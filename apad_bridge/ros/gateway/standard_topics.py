"""Publishes the fleet in ROS's standard messages, so that RViz, rqt, PlotJuggler and Foxglove show it without any code.

    /amusselN/battery_state, fix          sensor_msgs/BatteryState, NavSatFix: the belief
    /musselbed/apad/battery_state, fix    the same of the aPad
    /musselbed/apad/path                  nav_msgs/Path: its track
    /musselbed/plan                       nav_msgs/Path: from the aPad through the aMussels of the plan under way
    /musselbed/markers                    visualization_msgs/MarkerArray
    /diagnostics                          diagnostic_msgs/DiagnosticArray
    /tf, /tf_static                       frames by `apad_bridge.ros_names.frames`

Messages are made at ticks, and only for topics that have a subscriber. ROS resolves the names: remappings work.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import rospy
from diagnostic_msgs.msg import DiagnosticArray
from nav_msgs.msg import Path
from sensor_msgs.msg import BatteryState, NavSatFix
from tf2_msgs.msg import TFMessage
from visualization_msgs.msg import Marker, MarkerArray

from agents.time_scale import MissionMs
from apad_bridge.beliefs.belief import Belief
from apad_bridge.planning.solution import StepKind
from apad_bridge.ros.gateway import standard_messages as make
from apad_bridge.ros.gateway.fleet_diagnostics import diagnose
from apad_bridge.ros.gateway.never_blocking import Stalls, never_blocking_publisher
from apad_bridge.ros_names.frames import NED_IN_ENU, UPRIGHT, Frames, enu, yaw
from apad_bridge.ros_names.names import DIAGNOSTICS, TF, TF_STATIC, is_one_of_several, of_amussel, ours
from apad_bridge.ros_names.shown_fleet import APadTrack, apad_shape, ball_size_m
from apad_bridge.scenario.area.local_frame import LocalFrame
from apad_bridge.scenario.schema import Scenario
from apad_bridge.supervisor.context import Watcher
from apad_bridge.supervisor.supervisor import Supervisor

_QUEUE = 10
_NOTHING_KNOWN = (0.0, 0.0, 0.0)


class StandardTopics:
    """Owned by the flight's thread; the node is initialised before (`open_gateway`)."""

    def __init__(self, scenario: Scenario, agent_ids: Iterable[int], namespace: str = "") -> None:
        frames = self._frames = Frames(namespace)
        self.stalls = Stalls()
        self._ids = tuple(agent_ids)
        self._apad = scenario.apad.name
        self._diagnosed = self._apad if is_one_of_several(scenario) else ""
        self._namespace = namespace
        self._frame = LocalFrame.about(scenario.area.origin)
        self._rules = scenario.mission
        self._track = APadTrack()
        self._agents = {
            agent_id: (
                never_blocking_publisher(of_amussel(agent_id, "battery_state"), BatteryState, self.stalls),
                never_blocking_publisher(of_amussel(agent_id, "fix"), NavSatFix, self.stalls),
            )
            for agent_id in self._ids
        }
        self._battery = rospy.Publisher(ours("apad/battery_state"), BatteryState, queue_size=_QUEUE)
        self._fix = rospy.Publisher(ours("apad/fix"), NavSatFix, queue_size=_QUEUE)
        self._path = rospy.Publisher(ours("apad/path"), Path, queue_size=_QUEUE)
        self._plan = rospy.Publisher(ours("plan"), Path, queue_size=_QUEUE)
        self._markers = rospy.Publisher(ours("markers"), MarkerArray, queue_size=_QUEUE)
        self._ball_m = ball_size_m(scenario.area)
        self._diagnostics = rospy.Publisher(DIAGNOSTICS, DiagnosticArray, queue_size=_QUEUE)
        self._tf = rospy.Publisher(TF, TFMessage, queue_size=_QUEUE)
        self._tf_static = rospy.Publisher(TF_STATIC, TFMessage, queue_size=1, latch=True)
        self._tf_static.publish([make.transform(0, frames.enu, frames.ned, (0.0, 0.0, 0.0), NED_IN_ENU)])

    def watcher(self, supervisor: Supervisor) -> Watcher:
        """Publishes the supervisor's beliefs at each tick."""

        def watch(now_ms: MissionMs) -> None:
            beliefs = [belief for belief in supervisor.beliefs.all() if belief.agent_id in self._agents]
            self._show_agents(beliefs)
            self._show_apad(supervisor, now_ms)
            self._show_scene(supervisor, beliefs, now_ms)
            _publish(
                self._diagnostics,
                lambda: diagnose(
                    supervisor, self._ids, self._rules, now_ms, self._diagnosed, self._namespace
                ),
            )

        return watch

    def _show_agents(self, beliefs: list[Belief]) -> None:
        for belief in beliefs:
            battery, fix = self._agents[belief.agent_id]
            _publish(battery, lambda it=belief: make.agent_battery(it, self._frames.agent(it.agent_id)))
            _publish(fix, lambda it=belief: self._agent_fix(it))

    def _agent_fix(self, it: Belief) -> NavSatFix:
        body = self._frames.agent(it.agent_id)
        return make.fix(self._frame, it.at_ms, body, it.north_m, it.east_m, it.place_cov)

    def _show_apad(self, supervisor: Supervisor, now_ms: int) -> None:
        pose, battery, frames = supervisor.pose, supervisor.battery, self._frames
        if battery is not None:
            _publish(self._battery, lambda: make.apad_battery(battery, self._apad, frames.apad(self._apad)))
        if pose is None:
            return
        here_m = pose.place_m
        self._track.extend(here_m)
        body = frames.apad(self._apad)
        _publish(self._fix, lambda: make.fix(self._frame, pose.at_ms, body, *here_m, _NOTHING_KNOWN))
        _publish(self._path, lambda: make.path(now_ms, frames.enu, [*self._track.points_m, here_m]))
        _publish(self._plan, lambda: make.path(now_ms, frames.enu, [here_m, *_goals(supervisor)]))

    def _show_scene(self, supervisor: Supervisor, beliefs: list[Belief], now_ms: int) -> None:
        pose, frames = supervisor.pose, self._frames
        world = frames.enu

        def transforms() -> list[Any]:
            known = [
                make.transform(
                    now_ms,
                    world,
                    frames.agent(it.agent_id),
                    enu(it.north_m, it.east_m, it.reported.depth_m or 0.0),
                    UPRIGHT,
                )
                for it in beliefs
            ]
            if pose is not None:
                at, attitude = enu(pose.north_m, pose.east_m), yaw(pose.heading_rad)
                known.append(make.transform(now_ms, world, frames.apad(self._apad), at, attitude))
            return known

        _publish(self._tf, transforms)
        _publish(self._markers, lambda: fleet_markers(supervisor, self._ids, world, self._ball_m, now_ms))


def _goals(supervisor: Supervisor) -> list[tuple[float, float]]:
    """The goals of the current plan's steps, in order. A step whose place is not known is left out."""
    state = supervisor.mission.state
    homes = {agent_id: (north_m, east_m) for agent_id, north_m, east_m in state.homes}
    goals = []
    for step in state.plan:
        if step.kind is StepKind.DEPLOY:
            goal = homes.get(step.agent_id)
        else:
            belief = supervisor.beliefs.get(step.agent_id)
            goal = None if belief is None else (belief.north_m, belief.east_m)
        if goal is not None:
            goals.append(goal)
    return goals


def _publish(publisher: rospy.Publisher, make_message: Any) -> None:
    # Without a subscriber the message is not made.
    if publisher.get_num_connections() > 0:
        publisher.publish(make_message())


def fleet_markers(
    supervisor: Supervisor, agent_ids: Iterable[int], world: str, ball_m: float, now_ms: int
) -> list[Marker]:
    """The whole picture, in the frame `world`, with balls of this diameter; it does not depend on the one before.

    RViz keeps a marker until its deletion, so each picture begins with the deletion of all markers of its topic. A reader
    that loses the one deletion of a single marker would keep a ghost. Readers apply an array as one change, so nothing
    flickers. A lifetime would empty screens where mission time goes on and its supervisor does not.
    """
    clearing = Marker(header=make.header(now_ms, world), action=Marker.DELETEALL)
    clearing.pose.orientation.w = 1.0  # all 0 is no attitude, and readers complain of it
    # Each aPad draws the aMussels that it serves: one handed on is drawn by the aPad that serves it now.
    allocation, pose = supervisor.allocation, supervisor.pose
    ids = allocation.served_for_others.union(agent_ids)
    rows = {it: dock_index for dock_index, it in enumerate(supervisor.mission.docks) if it is not None}
    shown = [
        shape
        for it in allocation.all()
        if it.agent_id in ids and not it.is_of_another_board
        for shape in make.shown(it).shapes(ball_m, rows.get(it.agent_id, 0))
    ]
    if pose is not None:
        shown.append(apad_shape(enu(pose.north_m, pose.east_m), yaw(pose.heading_rad), ball_m))
    return [clearing, *(make.marker(now_ms, world, it) for it in shown)]
