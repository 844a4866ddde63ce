"""Publishes a camera's detections of simulated aMussels, for the vehicle's own visual servoing.

    camera = VirtualCamera("apad1")
    camera.show({7: (2.0, 3.0)})        # after each tick: where aMussels float

At each `position` of the aPad, in rospy's thread and from the last snapshot, it publishes `docking_horizontal`, `size`, and
last `docking_vertical` of the nearest aMussel in the image, or nothing while none is in it. `kinect_out` gives the camera's
direction.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

import rospy
from std_msgs.msg import Float32

from apad_bridge.ros.links.vehicle_subscribers import POSE_FIELDS
from apad_bridge.ros.system.ros_time import to_ms
from apad_bridge.ros.types.any_listener import AnyListener
from apad_bridge.ros.types.messages import use_generated_messages
from apad_bridge.ros_names.names import of_apad
from apad_bridge.vehicle.generation_b.messages import CAMERA_SERVO, dock_direction_rad
from apad_bridge.world.apad.camera import CameraSighting, seen

use_generated_messages()

from auv_msgs.msg import NavSts  # noqa: E402

DETECTION_TOPICS = ("docking_horizontal", "size", "docking_vertical")
Places = Mapping[int, tuple[float, float]]


class VirtualCamera:
    """The node is initialised before. The next detection replaces one that is not sent yet."""

    def __init__(self, name: str) -> None:
        self._places: Places = MappingProxyType({})
        self._direction_rad: float | None = None
        self._position_ms = -1
        self._processed = threading.Condition()
        self._out = {
            topic: rospy.Publisher(of_apad(name, topic), Float32, queue_size=1) for topic in DETECTION_TOPICS
        }
        # The link's own subscribers count unreadable messages.
        listener = AnyListener(lambda topic, node, why: None)
        self._subscribers = [
            listener.listen(of_apad(name, "kinect_out"), Float32, ("data",), self._turn),
            listener.listen(of_apad(name, "position"), NavSts, POSE_FIELDS, self._look),
        ]

    def show(self, places: Places) -> None:
        """Replaces the snapshot of visible floating aMussels: (north, east) in metres by id."""
        self._places = MappingProxyType(dict(places))

    def wait_until_published(self, now_ms: int, timeout_s: float) -> bool:
        """In step with our own clock: waits for the detections from the aPad's position at `now_ms`."""
        with self._processed:
            return self._processed.wait_for(lambda: self._position_ms >= now_ms, timeout_s)

    def close(self) -> None:
        for subscriber in self._subscribers:
            subscriber.unregister()
        for publisher in self._out.values():
            publisher.unregister()

    def _turn(self, message: Any) -> None:
        dock_index = min(range(len(CAMERA_SERVO)), key=lambda it: abs(CAMERA_SERVO[it] - message.data))
        self._direction_rad = dock_direction_rad(dock_index)

    def _look(self, message: Any) -> None:
        place_m = (message.position.north, message.position.east)
        if (nearest := self._nearest(place_m, message.orientation.yaw)) is not None:
            self._out["docking_horizontal"].publish(Float32(nearest.horizontal))
            self._out["size"].publish(Float32(nearest.size))
            self._out["docking_vertical"].publish(Float32(nearest.vertical))
        with self._processed:
            self._position_ms = max(self._position_ms, to_ms(message.header.stamp))
            self._processed.notify_all()

    def _nearest(self, place_m: tuple[float, float], heading_rad: float) -> CameraSighting | None:
        if self._direction_rad is None:
            return None
        nearest_first = sorted(self._places.values(), key=lambda other_m: math.dist(place_m, other_m))
        views = (seen(place_m, heading_rad, self._direction_rad, other_m) for other_m in nearest_first)
        return next((it for it in views if it is not None), None)
