"""All that an aPad of generation B says, converted in rospy's threads and left in an inbox: nothing else happens here."""

from __future__ import annotations

from typing import Any

import rospy
from std_msgs.msg import Bool, Float32MultiArray, Float64, Int32, String

from apad_bridge.ros.any_listener import AnyListener
from apad_bridge.ros.generation_b_words import (
    PRIMITIVE_FINISHED,
    ArmHeard,
    FinishedHeard,
    Heard,
    PilotHeard,
    Status,
    StatusHeard,
)
from apad_bridge.ros.inbox import Inbox
from apad_bridge.ros.legacy_words import UNSTAMPED, BatteryHeard, PoseHeard, StateHeard
from apad_bridge.ros.messages import use_generated_messages
from apad_bridge.ros.names import of_apad
from apad_bridge.ros.ros_time import to_ms

use_generated_messages()

from auv_msgs.msg import NavSts  # noqa: E402

_OPEN = 0.5
"""`dock_out` is 1.0 for an arm that stands open, and 0.0."""


class Ears:
    """Subscribes to the aPad called `name`. With `stamped`, poses carry their messages' stamps; nothing else has one."""

    def __init__(self, name: str, inbox: Inbox[Heard], *, stamped: bool) -> None:
        self._inbox = inbox
        self._stamped = stamped
        self._listener = AnyListener(inbox.drop)
        self.needed: dict[str, tuple[Any, tuple[str, ...]]] = {}
        """By topic of the aPad: our message class, and the fields that are read."""
        self._vital = [self._listen(of_apad(name, "position"), NavSts, self._take_pose)]
        state = self._listen(of_apad(name, "stateRef"), NavSts, self._take_state)
        if stamped:
            self._vital.append(state)
        self._others = [
            state,
            self._listen(of_apad(name, "battery_level"), Float64, self._take_battery),
            self._listen(of_apad(name, "goto_status"), Int32, self._take_status, False),
            self._listen(of_apad(name, "docking_status"), Int32, self._take_status, True),
            self._listen(of_apad(name, "eventString"), String, self._take_event),
            self._listen(of_apad(name, "manual"), Bool, self._take_manual),
            self._listen(of_apad(name, "dock_out"), Float32MultiArray, self._take_arms),
        ]

    @property
    def missing(self) -> list[str]:
        """What is not connected of that which a flight cannot do without, for a person."""
        return [f"nobody publishes {it.resolved_name}" for it in self._vital if not it.get_num_connections()]

    def close(self) -> None:
        for subscriber in [*self._vital, *self._others]:
            subscriber.unregister()

    def _listen(self, topic: str, kind: Any, take: Any, *arguments: Any) -> rospy.Subscriber:
        nav_sts = ("header.stamp", "position.north", "position.east", "orientation.yaw")
        subscriber = self._listener.listen(topic, kind, take, *arguments)
        self.needed[subscriber.resolved_name] = (kind, nav_sts if kind is NavSts else ("data",))
        return subscriber

    def _stamp(self, message: Any) -> int:
        return to_ms(message.header.stamp) if self._stamped else UNSTAMPED

    def _take_pose(self, message: Any) -> None:
        position, yaw = message.position, message.orientation.yaw
        self._inbox.put(PoseHeard(self._stamp(message), position.north, position.east, yaw))

    def _take_state(self, message: Any) -> None:
        self._inbox.put(StateHeard(self._stamp(message)))

    def _take_battery(self, message: Any) -> None:
        self._inbox.put(BatteryHeard(UNSTAMPED, message.data))

    def _take_status(self, message: Any, docking: bool) -> None:
        try:
            heard = StatusHeard(UNSTAMPED, docking, Status(message.data))
        except ValueError:
            self._inbox.drop("a primitive's status of no known code")
            return
        self._inbox.put(heard, always=True)

    def _take_event(self, message: Any) -> None:
        if message.data == PRIMITIVE_FINISHED:
            self._inbox.put(FinishedHeard(UNSTAMPED))

    def _take_manual(self, message: Any) -> None:
        self._inbox.put(PilotHeard(UNSTAMPED, bool(message.data)), always=True)

    def _take_arms(self, message: Any) -> None:
        slot = next((slot for slot, opening in enumerate(message.data) if opening > _OPEN), None)
        self._inbox.put(ArmHeard(UNSTAMPED, slot), always=True)
