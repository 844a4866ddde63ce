"""The door to a live aPad, which ROS's libraries open, and the aPad as the checks see it through that door."""

from __future__ import annotations

import math
import struct
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from apad_bridge.doctor.definitions import Md5s
from apad_bridge.doctor.graph_checks import Graph
from apad_bridge.doctor.network import TIMEOUT_S
from apad_bridge.doctor.positions import PositionSample

_FLOAT64, _LENGTH = struct.Struct("<d"), struct.Struct("<I")
_PROMPT_TOPICS = ("action_server/status", "go2point/status", "dynamic_positioning/status")
"""Topics whose messages are stamped as they are sent: the states of actions, of either generation."""
MOST_CHARGE = 1.05
"""Gauges in the field overshoot a little."""
_STAMPS = 4
_STAMPS_WITHIN_S = 3.0


class NotAnnounced(Exception):
    """The node gave no answer. The text is the reason."""


@dataclass(frozen=True, slots=True)
class Door:
    """Functions of a graph and a name in full; `apad_bridge.ros.door` has ours. NotAnnounced where nothing answers."""

    topic_md5: Callable[[Graph, str], str]
    service_md5: Callable[[Graph, str], str]
    messages: Callable[[Graph, str, int, float], list[bytes]]
    """The next so many messages within so many seconds, serialised; the first may be a latched one."""
    stamp_offsets_s: Callable[[Graph, str, int, float], list[float]]
    """The next stamps minus this machine's clock, up to so many within so many seconds, and one at least."""
    positions: Callable[[Graph, str, float], list[PositionSample]]
    """Those of so many seconds; none where nobody publishes."""
    answer: Callable[[Graph, str, str], Any]
    """The response of a service of this type (such as misc_msgs/GetDockingInfo) whose request is empty."""
    our_md5s: Callable[[], Md5s]
    """Those of the definitions that musselbed speaks."""
    is_by_text: Callable[[str, str], bool]
    """A text on ROS_PACKAGE_PATH defines a service's type by this md5."""


@dataclass(frozen=True, slots=True)
class TopicSeen:
    """A topic of the vehicle: whether a node publishes it, and its newest value, None where it is silent."""

    is_published: bool
    value: Any = None


@dataclass(frozen=True)
class LiveAPad:
    """An aPad on the graph; `name` is its namespace in full."""

    door: Door
    graph: Graph
    name: str

    def topic(self, leaf: str) -> str:
        return f"{self.name}/{leaf}"

    def positions(self, seconds: float) -> list[PositionSample]:
        return self.door.positions(self.graph, self.topic("position"), seconds)

    def clock_offset_s(self) -> float | None:
        """The vehicle's clock minus this machine's, by a topic that no filter delays; None without such a topic.

        The nearest of some messages counts: the network can only make a stamp older.
        """
        for leaf in _PROMPT_TOPICS:
            try:
                return max(self.door.stamp_offsets_s(self.graph, self.topic(leaf), _STAMPS, _STAMPS_WITHIN_S))
            except NotAnnounced:
                continue
        return None

    def battery_percent(self) -> float:
        """Its charge by its topic or, where that is silent, by generation A's service. NotAnnounced for neither."""
        try:
            (message,) = self.door.messages(self.graph, self.topic("battery_level"), 1, TIMEOUT_S)
        except NotAnnounced as silent:
            service = self.topic("get_battery_level")
            if service not in self.graph.services:
                raise
            try:
                return float(self.door.answer(self.graph, service, "misc_msgs/GetChargeInfo").battery_level)
            except NotAnnounced as error:
                raise NotAnnounced(f"{silent}; and {service}: {error}") from None
        if len(message) != _FLOAT64.size:
            raise NotAnnounced("its messages are no std_msgs/Float64")
        (percent,) = _FLOAT64.unpack(message)
        return float(percent)

    def charge(self) -> float | None:
        """Its charge as a fraction; None where nothing tells it, or tells what is no number."""
        try:
            percent = self.battery_percent()
        except NotAnnounced:
            return None
        return percent / 100 if math.isfinite(percent) else None

    def heard_bool(self, leaf: str) -> TopicSeen:
        return self._heard(leaf, 1, lambda data: data[:1] == b"\x01")

    def heard_text(self, leaf: str) -> TopicSeen:
        """The newer of two messages: the first may be the latched word of a node that is dead."""
        return self._heard(leaf, 2, _text)

    def _heard(self, leaf: str, count: int, read: Callable[[bytes], Any]) -> TopicSeen:
        topic = self.topic(leaf)
        if not self.graph.living_publishers(topic):
            return TopicSeen(is_published=False)
        try:
            return TopicSeen(True, read(self.door.messages(self.graph, topic, count, TIMEOUT_S)[-1]))
        except (NotAnnounced, struct.error, UnicodeDecodeError):
            return TopicSeen(is_published=True)


def _text(data: bytes) -> str:
    (length,) = _LENGTH.unpack_from(data)
    return data[_LENGTH.size : _LENGTH.size + length].decode()
