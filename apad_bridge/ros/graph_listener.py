"""Listens to topics of somebody's graph and does nothing else: no publisher, no call of a service, no goal.

The messages are handed on as a recorder has them, with their publishers' own definitions. The log stays off the graph,
for /rosout would be a publisher of ours.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from io import BytesIO
from typing import Any

import rospy

from apad_bridge.records.bag import RecordedConnection, RecordedMessage
from apad_bridge.ros.system.inbox import Inbox
from apad_bridge.ros.system.node import start_node


class GraphListener:
    """A node that subscribes to `topics`. The master at ROS_MASTER_URI must answer: rospy waits for it for ever."""

    def __init__(self, topics: Iterable[str], node: str) -> None:
        """`node` begins the node's name, which ROS makes unique."""
        start_node(node, is_anonymous=True, logs_on_graph=False)
        self._inbox: Inbox[RecordedMessage] = Inbox()
        self._connections: dict[tuple[str, str], RecordedConnection] = {}
        self._subscribers: dict[str, rospy.Subscriber] = {}
        self._before_clock: dict[tuple[str, str], Any] = {}
        """By topic and publisher: a latched message from before the first time of a simulated clock. It comes once."""
        for topic in topics:
            self.listen(topic)

    def listen(self, topic: str) -> None:
        """Subscribes to one topic more."""
        self._subscribers[topic] = rospy.Subscriber(topic, rospy.AnyMsg, self._put, topic, tcp_nodelay=True)

    def leave(self, topic: str) -> None:
        """Ends the subscription to a topic that it listens to."""
        self._subscribers.pop(topic).unregister()

    @property
    def dropped(self) -> Counter[str]:
        return self._inbox.dropped

    def now_ns(self) -> int:
        """The graph's time; 0 before the first time of a simulated clock."""
        return int(rospy.Time.now().to_nsec())

    def take(self, wait_s: float) -> list[RecordedMessage]:
        """The messages since the last call, in the order heard; waits so long for the first."""
        return self._inbox.take(wait_s)

    def close(self) -> None:
        """Leaves the graph. The process cannot listen again."""
        for subscriber in self._subscribers.values():
            subscriber.unregister()
        rospy.signal_shutdown("it has heard enough")

    def _put(self, message: Any, topic: str) -> None:
        at_ns = self.now_ns()
        if at_ns == 0:
            header = message._connection_header
            if header.get("latching") == "1":
                self._before_clock[topic, header["callerid"]] = message
            return
        for early in list(self._before_clock):
            if (latched := self._before_clock.pop(early, None)) is not None:  # by one of rospy's threads
                self._hand_on(latched, early[0], at_ns)
        self._hand_on(message, topic, at_ns)

    def _hand_on(self, message: Any, topic: str, at_ns: int) -> None:
        header = message._connection_header
        key = topic, header["md5sum"]
        if key not in self._connections:
            kind = header["type"].replace("/", "/msg/", 1)
            self._connections[key] = RecordedConnection(
                topic, kind, header["message_definition"], header["md5sum"]
            )
        self._inbox.put(RecordedMessage(self._connections[key], at_ns, _bytes_of(message)))


def _bytes_of(message: Any) -> bytes:
    """The message as it came. rospy has one reader a topic, and itself reads a simulated /clock by its class."""
    if isinstance(message, rospy.AnyMsg):
        return bytes(message._buff)
    buffer = BytesIO()
    message.serialize(buffer)
    return buffer.getvalue()
