"""The base of every simulated aPad's node: follows a clock, and publishes where the vehicle is."""

from __future__ import annotations

import threading
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from contextlib import suppress
from typing import Any, Generic, Self, TypeVar

import rospy
from rosgraph_msgs.msg import Clock

from apad_bridge.ros.system.node import ned_frame
from apad_bridge.ros.system.ros_time import to_ms, to_ros
from apad_bridge.ros.types.messages import use_generated_messages
from apad_bridge.ros_names.names import CLOCK, CLOCK_REACHED, of_apad
from apad_bridge.scenario.area.local_frame import LocalFrame
from apad_bridge.scenario.schema import Scenario
from apad_bridge.world.apad.kinematics import Pose
from apad_bridge.world.simulated_stack import SimulatedStack

use_generated_messages()

from auv_msgs.msg import NavSts  # noqa: E402

QUEUE = 200
"""Ten seconds of the fastest topic. A slower reader loses the oldest, and nobody waits for it."""
_VARIANCE_M2 = 1e-4
"""It knows its place to the float; a filter that tells a variance of 0 tells none."""
Vehicle = TypeVar("Vehicle", bound=SimulatedStack[Any])


class LegacyServer(ABC, Generic[Vehicle]):
    """Serves the aPad called `name`. `lock` guards the vehicle, which is made when the first time arrives."""

    def __init__(
        self, name: str, make_vehicle: Callable[[int], Vehicle], lock: threading.RLock, frame: LocalFrame
    ) -> None:
        self.clock_arrived_s = time.monotonic()
        self._frame = frame
        self._make_vehicle = make_vehicle
        self._vehicle: Vehicle | None = None
        self._lock = lock
        self._position = rospy.Publisher(of_apad(name, "position"), NavSts, queue_size=QUEUE)
        self._state = rospy.Publisher(of_apad(name, "stateRef"), NavSts, queue_size=QUEUE)
        _set_origin(name, frame)

    @classmethod
    @abstractmethod
    def of_scenario(cls, scenario: Scenario, held: Mapping[int, int]) -> Self:
        """The server around the simulated vehicle of this scenario. The node is initialised before.

        `held` are the aMussels that its docks hold at the start, by dock index.
        """

    @abstractmethod
    def _show(self, shown: list[Any]) -> None:
        """Publishes what the vehicle shows."""

    def follow_clock(self) -> None:
        """From now on time is /clock's; otherwise the owner calls `advance_to`."""
        reached = rospy.Publisher(CLOCK_REACHED, Clock, queue_size=QUEUE, latch=True)
        rospy.Subscriber(CLOCK, Clock, self._take_clock, reached, tcp_nodelay=True)

    def _take_clock(self, message: Any, reached: rospy.Publisher) -> None:
        self.clock_arrived_s = time.monotonic()
        self.advance_to(to_ms(message.clock))
        reached.publish(message)

    def advance_to(self, now_ms: int) -> None:
        """Lets the vehicle's time pass to `now_ms`, publishes the outcome, and last `stateRef` of that time."""
        with self._lock:
            if self._vehicle is None:
                self._vehicle = self._make_vehicle(now_ms)
            if now_ms < self._vehicle.now_ms:
                # It happens when a supervisor is killed between two ticks and the next goes on from the earlier one.
                rospy.logwarn_throttle(10, f"/clock went back to {now_ms} ms: not followed")
            else:
                self._show(self._vehicle.advance(now_ms))
            self._publish_pose(self._state, self._vehicle.now_ms, self._vehicle.pose)

    def _do(self, act: Callable[[Vehicle], list[Any]]) -> None:
        """Publishes the outcome of `act`. Without a vehicle, before the first time arrives, it does nothing."""
        with self._lock:
            if self._vehicle is not None:
                self._show(act(self._vehicle))

    def _running(self) -> Vehicle:
        """The vehicle, for a service: ServiceException while there is none."""
        if self._vehicle is None:
            raise rospy.ServiceException("no /clock came yet")
        return self._vehicle

    def _publish_pose(self, publisher: rospy.Publisher, at_ms: int, pose: Pose) -> None:
        """Names its origin and its quality, as a vehicle with a filter does; the published simulator leaves them at 0."""
        if publisher.get_num_connections() == 0:
            return
        message, frame = NavSts(), self._frame
        message.header.stamp = to_ros(at_ms)
        message.header.frame_id = ned_frame()
        message.origin.latitude, message.origin.longitude = frame.latitude_deg, frame.longitude_deg
        place_deg = frame.to_geographic(pose.north_m, pose.east_m)
        message.global_position.latitude, message.global_position.longitude = place_deg
        message.position.north, message.position.east = pose.north_m, pose.east_m
        message.position_variance.north = message.position_variance.east = _VARIANCE_M2
        message.gbody_velocity.x, message.gbody_velocity.y = pose.north_m_s, pose.east_m_s
        message.orientation.yaw = pose.heading_rad
        message.status = NavSts.STATUS_ALL_OK
        publisher.publish(message)


def _set_origin(name: str, frame: LocalFrame) -> None:
    """Sets the parameters of the origin, in degrees, in the aPad's namespace, until the node ends.

    One that was left would vouch for the next vehicle of this name, to its guards too.
    """
    degrees = {
        of_apad(name, "LocalOriginLat"): frame.latitude_deg,
        of_apad(name, "LocalOriginLon"): frame.longitude_deg,
    }
    for parameter, value in degrees.items():
        rospy.set_param(parameter, value)

    def remove() -> None:
        with suppress(OSError, rospy.ROSException, KeyError):  # a master that has ended has no parameters
            for parameter in degrees:
                rospy.delete_param(parameter)

    rospy.on_shutdown(remove)
