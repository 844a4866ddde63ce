"""The actionlib server `go2point` (navcon_msgs/GoToPointAction), which lies underneath generation B's services.

Every go-to is a goal here. One that a service ordered is the commander's own goal: the commander is a client of the server.
So the goal appears on the topic `goal`, and in `status`, `feedback` and `result`, as any other.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import rospy
from actionlib.action_server import ActionServer

from apad_bridge.ros.system.node import ned_frame
from apad_bridge.ros.system.ros_time import to_ros
from apad_bridge.ros.types.messages import use_generated_messages
from apad_bridge.ros_names.names import of_apad
from apad_bridge.vehicle.commands import GoTo
from apad_bridge.vehicle.generation_b.messages import PrimitiveStatus
from apad_bridge.world.generation_b import simulated_messages
from apad_bridge.world.generation_b.simulated_messages import GoToBegun, GoToEnded, GoToLeft

use_generated_messages()

from navcon_msgs.msg import GoToPointAction, GoToPointActionGoal, GoToPointFeedback, GoToPointResult  # noqa: E402

TakeOrder = Callable[[GoTo], bool | None]
"""Passes an order to the vehicle, and its outcome to `show`. Returns the answer of a service, None for never."""


class Go2Point:
    """The caller holds `lock`, and `order` and `stop` are called with it held."""

    def __init__(self, apad: str, order: TakeOrder, stop: Callable[[], None]) -> None:
        self._commander = rospy.resolve_name(f"{apad}/commander")
        self._commanded = 0
        self._order = order
        self._stop = stop
        self._requested: Any = None
        """The handle of the goal whose order is just being taken."""
        self._running: Any = None
        # Its own status timer would sleep on ROS time: `publish_status` publishes the status each second instead.
        rospy.set_param("~actionlib_status_frequency", 0.0)
        server = of_apad(apad, "go2point")
        self._server = ActionServer(
            server, GoToPointAction, self._take_goal, self._cancel_goal, auto_start=False
        )
        self.lock = self._server.lock
        self._goal_topic = rospy.Publisher(f"{server}/goal", GoToPointActionGoal, queue_size=16)

    def start(self) -> None:
        self._server.start()

    def show(self, shown: GoToBegun | GoToLeft | GoToEnded) -> None:
        match shown:
            case GoToBegun(_, order):
                if self._requested is None:
                    self._add_goal(order)
                self._running, self._requested = self._requested, None
                self._running.set_accepted()
            case GoToLeft(_, distance_m, bearing_rad) if self._running is not None:
                self._running.publish_feedback(GoToPointFeedback(distance_m, bearing_rad))
            case GoToEnded() if self._running is not None:
                self._end(shown)

    def publish_status(self) -> None:
        self._server.publish_status()

    def _take_goal(self, handle: Any) -> None:
        self._requested = handle
        if handle.get_goal_id().id == self._commanders_key:
            return
        if self._order(simulated_messages.goal(handle.get_goal())) is False:
            handle.set_rejected(None, "the vehicle takes no orders")
        self._requested = None

    def _cancel_goal(self, handle: Any) -> None:
        if handle == self._running:
            self._stop()

    @property
    def _commanders_key(self) -> str:
        return f"{self._commander}-{self._commanded}"

    def _add_goal(self, order: GoTo) -> None:
        """Makes a goal of a service's order, and shows it. `_take_goal` receives it and recognises it by its key.

        The server's own subscriber hears it a second time, and actionlib leaves out a goal whose key it knows.
        """
        self._commanded += 1
        message = GoToPointActionGoal()
        message.goal_id.id = self._commanders_key
        message.goal.T2.header.frame_id = ned_frame()
        message.goal.T2.point.x, message.goal.T2.point.y = order.north_m, order.east_m
        message.goal.speed, message.goal.victory_radius = order.speed_m_s, order.victory_radius_m
        self._server.internal_goal_callback(message)
        self._goal_topic.publish(message)

    def _end(self, ended: GoToEnded) -> None:
        handle, self._running = self._running, None
        result = GoToPointResult(distance=ended.left.distance_m, bearing=ended.left.bearing_rad)
        result.position.header.stamp = to_ros(ended.left.at_ms)
        result.position.header.frame_id = ned_frame()
        result.position.point.x, result.position.point.y = ended.pose.north_m, ended.pose.east_m
        match ended.status:
            case PrimitiveStatus.DONE:
                handle.set_succeeded(result)
            case PrimitiveStatus.PREEMPTED:
                handle.set_canceled(result)
            case _:
                handle.set_aborted(result)
