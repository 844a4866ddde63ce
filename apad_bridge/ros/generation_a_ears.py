"""All that an aPad of generation A says, converted in rospy's threads and left in an inbox: nothing else happens here.

Pose is taken from `position` and not from `stateRef`: by its name and its place in the published stack that is what the
vehicle's controllers refer to, and `position` is where the vehicle is. Of ours, both are the same.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import rospy
from actionlib_msgs.msg import GoalStatusArray
from std_msgs.msg import Float64

from apad_bridge.ros.any_listener import AnyListener
from apad_bridge.ros.generation_a_words import (
    GoalCode,
    GoalsHeard,
    GoalWord,
    Heard,
    StaticHeard,
)
from apad_bridge.ros.inbox import Inbox
from apad_bridge.ros.legacy_words import UNSTAMPED, BatteryHeard, PoseHeard, StateHeard
from apad_bridge.ros.messages import use_generated_messages
from apad_bridge.ros.names import of_amussel, of_apad
from apad_bridge.ros.ros_time import to_ms

use_generated_messages()

from apad.msg import aPadActionResult  # noqa: E402
from auv_msgs.msg import NavSts  # noqa: E402

_FIELDS: dict[Any, tuple[str, ...]] = {
    NavSts: ("header.stamp", "position.north", "position.east", "orientation.yaw", "status"),
    GoalStatusArray: ("header.stamp", "status_list"),
    aPadActionResult: ("header.stamp", "status.goal_id.id", "status.status", "status.text"),
    Float64: ("data",),
}


class Ears:
    """Subscribes to the aPad called `name` and to `position_static` of each aMussel.

    With `stamped`, facts carry the stamps of the messages; without, and where generation A has none, UNSTAMPED.
    """

    def __init__(self, name: str, agent_ids: Iterable[int], inbox: Inbox[Heard], *, stamped: bool) -> None:
        self.has_heard_server = False
        self._inbox = inbox
        self._stamped = stamped
        self._listener = AnyListener(inbox.drop)
        self.needed: dict[str, tuple[Any, tuple[str, ...]]] = {}
        """By topic of the aPad: our message class, and the fields that are read."""
        server = of_apad(name, "action_server")
        self._vital = [
            self._listen(of_apad(name, "position"), NavSts, self._take_pose),
            self._listen(f"{server}/status", GoalStatusArray, self._take_status),
            self._listen(f"{server}/result", aPadActionResult, self._take_result),
        ]
        self._battery = self._listen(of_apad(name, "battery_level"), Float64, self._take_battery)
        state = self._listen(of_apad(name, "stateRef"), NavSts, self._take_state)
        if stamped:
            self._vital.append(state)
        self._subscribers = [
            *self._vital,
            self._battery,
            state,
            *(
                self._listen(of_amussel(it, "position_static"), NavSts, self._take_static, it)
                for it in agent_ids
            ),
        ]

    @property
    def missing(self) -> list[str]:
        """What is not connected of that which a flight cannot do without, for a person."""
        lines = [f"nobody publishes {it.resolved_name}" for it in self._vital if not it.get_num_connections()]
        return lines if self.has_heard_server else [*lines, "no word of its action server"]

    def close(self) -> None:
        for subscriber in self._subscribers:
            subscriber.unregister()

    def _listen(self, topic: str, kind: Any, take: Any, *arguments: Any) -> rospy.Subscriber:
        subscriber = self._listener.listen(topic, kind, take, *arguments)
        if not arguments:
            self.needed[subscriber.resolved_name] = (kind, _FIELDS[kind])
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

    def _take_static(self, message: Any, agent_id: int) -> None:
        position, released = message.position, message.status == 1
        heard = StaticHeard(self._stamp(message), agent_id, position.north, position.east, released)
        self._inbox.put(heard, always=released)

    def _take_status(self, message: Any) -> None:
        self.has_heard_server = True
        self._inbox.put(GoalsHeard(self._stamp(message), self._words(message.status_list), whole=True))

    def _take_result(self, message: Any) -> None:
        heard = GoalsHeard(self._stamp(message), self._words([message.status]), whole=False)
        self._inbox.put(heard, always=True)

    def _words(self, statuses: Iterable[Any]) -> tuple[GoalWord, ...]:
        words = []
        for status in statuses:
            try:
                words.append(GoalWord(status.goal_id.id, GoalCode(status.status), status.text))
            except ValueError:
                self._inbox.drop("a goal's status of no known code")
        return tuple(words)
