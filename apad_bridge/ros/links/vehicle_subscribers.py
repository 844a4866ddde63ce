"""Subscribes to the topics of both generations: converts messages in rospy's threads and leaves them in an inbox.

The pose comes from `position` and not from `stateRef`: by its name and its place in the published stack, `stateRef` is the
reference of the vehicle's controllers, and `position` is where the vehicle is. The simulated aPad publishes one on both.
"""

from __future__ import annotations

import math
import struct
import threading
import time
from collections import defaultdict
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import rospy
from std_msgs.msg import Float64

from apad_bridge.ros.links.second_connection import FirstArrivals, SecondConnections
from apad_bridge.ros.system.inbox import Inbox
from apad_bridge.ros.system.ros_time import arrival_ms, to_ms
from apad_bridge.ros.types.any_listener import AnyListener
from apad_bridge.ros.types.messages import use_generated_messages
from apad_bridge.ros_names.names import of_apad
from apad_bridge.vehicle.commands import PoseReported
from apad_bridge.vehicle.stack_messages import UNSTAMPED, BatteryReceived, StateRefReceived

use_generated_messages()

from auv_msgs.msg import NavSts  # noqa: E402

_POSE = struct.Struct("<Iq3d")
"""A position as it was sent: number, stamp, place and yaw. Bytes, since NaN does not equal itself."""
POSE_FIELDS = ("header.stamp", "position.north", "position.east", "orientation.yaw")


class VehicleSubscribers:
    """Subscribes to the aPad called `name`. With `stamped`, facts carry their messages' stamps; without, UNSTAMPED.

    `pose_fields` are the fields that its NavSts must have.
    """

    def __init__(
        self, name: str, inbox: Inbox[Any], *, stamped: bool, pose_fields: tuple[str, ...] = POSE_FIELDS
    ) -> None:
        self.needed: dict[str, tuple[Any, tuple[str, ...]]] = {}
        """By topic of the aPad: our message class, and the fields read of it."""
        self._inbox = inbox
        self._stamped = stamped
        self._listener = AnyListener(inbox.refuse)
        self._subscribers: list[rospy.Subscriber] = []
        self._vital: list[rospy.Subscriber] = []
        """No flight begins without these."""
        self._first_arrivals: defaultdict[str, FirstArrivals] = defaultdict(FirstArrivals)
        """By the publisher's name."""
        self._one_at_a_time = threading.Lock()
        position = of_apad(name, "position")
        self._second = SecondConnections(
            self._listener.receiver(position, NavSts, pose_fields, self._take_pose, 1)
        )
        self._position = self._listen(position, NavSts, pose_fields, self._take_pose, 0, is_vital=True)
        self._listen(of_apad(name, "stateRef"), NavSts, pose_fields, self._take_state, is_vital=stamped)
        self._listen(of_apad(name, "battery_level"), Float64, ("data",), self._take_battery)

    @property
    def missing(self) -> list[str]:
        """A line for a person about each part that a flight needs and that is not connected."""
        return [f"nobody publishes {it.resolved_name}" for it in self._vital if not it.get_num_connections()]

    def close(self) -> None:
        for subscriber in self._subscribers:
            subscriber.unregister()
        self._second.close()

    def _listen(
        self,
        topic: str,
        kind: Any,
        fields: tuple[str, ...],
        take: Callable[..., None],
        *arguments: Any,
        is_vital: bool = False,
        is_checked_before: bool = True,
    ) -> rospy.Subscriber:
        """Calls `take(message, *arguments)`, which reads `fields`, in rospy's thread.

        With `is_checked_before` no flight begins against a publisher whose definition lacks one of them.
        """
        subscriber = self._listener.listen(topic, kind, fields, take, *arguments)
        self._subscribers.append(subscriber)
        if is_vital:
            self._vital.append(subscriber)
        if is_checked_before:
            self.needed[subscriber.resolved_name] = (kind, fields)
        return subscriber

    def _stamp(self, message: Any) -> int:
        return to_ms(message.header.stamp) if self._stamped else UNSTAMPED

    def _take_pose(self, message: Any, connection: int) -> None:
        """Takes a position that came over the first connection (0) or the second (1)."""
        position, yaw, publisher = message.position, message.orientation.yaw, publisher_of(message)
        stamp_ms = to_ms(message.header.stamp) or None  # 0 is no time
        heard_ms = None if self._stamped else arrival_ms()
        pose = PoseReported(
            self._stamp(message), position.north, position.east, yaw, stamp_ms, heard_ms=heard_ms
        )
        sent = _POSE.pack(
            message.header.seq, message.header.stamp.to_nsec(), position.north, position.east, yaw
        )
        # The connections have a thread each: what came first must be put first.
        with self._one_at_a_time:
            if self._first_arrivals[publisher].is_new(connection, sent, time.monotonic()):
                self._inbox.put(replace(pose, speed_m_s=_speed_m_s(message), publisher=publisher))
        if connection == 0:
            self._second.follow(self._position)

    def _take_state(self, message: Any) -> None:
        self._inbox.put(StateRefReceived(self._stamp(message)))

    def _take_battery(self, message: Any) -> None:
        self._inbox.put(BatteryReceived(UNSTAMPED, message.data))


def _speed_m_s(message: Any) -> float | None:
    """The speed over ground, by `gbody_velocity`; None where the message has none, or no number."""
    velocity = getattr(message, "gbody_velocity", None)
    speed_m_s = math.hypot(getattr(velocity, "x", math.nan), getattr(velocity, "y", math.nan))
    return speed_m_s if math.isfinite(speed_m_s) else None


def publisher_of(message: Any) -> str:
    header = getattr(message, "_connection_header", None)
    return str(header.get("callerid", "")) if isinstance(header, dict) else ""
