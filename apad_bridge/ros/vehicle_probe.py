"""Reads what a vehicle tells without a node on the graph: its positions, its clock, its charge, its switches."""

from __future__ import annotations

import math
import struct
import time
from collections.abc import Callable
from typing import Any

from genpy import DeserializationError

from apad_bridge.doctor.graph import Graph
from apad_bridge.doctor.positions import PositionSample
from apad_bridge.doctor.preflight import TopicSeen
from apad_bridge.ros.types.any_message import AnyMessages
from apad_bridge.ros.types.messages import use_generated_messages
from apad_bridge.ros.types.wire_probe import (
    NotAnnounced,
    call_without_words,
    messages_within,
    next_messages,
    stamp_offset_s,
)

_FLOAT64, _LENGTH = struct.Struct("<d"), struct.Struct("<I")
_PROMPT_TOPICS = ("action_server/status", "go2point/status", "dynamic_positioning/status")
"""Topics whose messages are stamped as they are sent: the states of actions, of either generation."""
_STAMPS = 4
_STAMPS_WITHIN_S = 3.0


def positions(graph: Graph, topic: str, seconds: float) -> list[PositionSample]:
    """Messages of so many seconds, read by the publisher's own definition. An unreadable message is no position."""
    try:
        spoken, messages = messages_within(graph, topic, seconds)
        kind = AnyMessages().class_of(spoken.kind, spoken.md5, spoken.text)
    except (NotAnnounced, ValueError):
        return []
    wall_s = time.time() - time.monotonic()
    samples = []
    for at_s, data in messages:
        try:
            samples.append(_sample(at_s, at_s + wall_s, kind().deserialize(data)))
        except Exception:  # genpy raises whatever its generated code raises
            continue
    return samples


def _sample(at_s: float, wall_s: float, message: Any) -> PositionSample:
    def number(path: str) -> float:
        value = message
        for part in path.split("."):
            value = getattr(value, part, 0.0)
        return float(value)

    return PositionSample(
        at_s,
        message.header.seq,
        message.position.north,
        message.position.east,
        getattr(message, "status", 0),
        number("position_variance.north"),
        number("position_variance.east"),
        number("orientation.yaw"),
        message.header.stamp.to_sec(),
        wall_s,
        (number("origin.latitude"), number("origin.longitude")),
        (number("global_position.latitude"), number("global_position.longitude")),
    )


def clock_offset_s(graph: Graph, apad: str) -> float | None:
    """The vehicle's clock minus this machine's, by a topic that no filter delays; None without such a topic.

    The nearest of some messages counts: the network can only make a stamp older.
    """
    for leaf in _PROMPT_TOPICS:
        try:
            return max(stamp_offset_s(graph, f"{apad}/{leaf}", _STAMPS, _STAMPS_WITHIN_S))
        except NotAnnounced:
            continue
    return None


def battery_percent(graph: Graph, apad: str) -> float:
    """The aPad's charge by its topic or, where that is silent, by generation A's service. NotAnnounced for neither."""
    try:
        (message,) = next_messages(graph, f"{apad}/battery_level")
    except NotAnnounced as silent:
        service = f"{apad}/get_battery_level"
        if service not in graph.services:
            raise
        use_generated_messages()
        from misc_msgs.srv import GetChargeInfo, GetChargeInfoResponse

        try:
            answer = call_without_words(graph, service, GetChargeInfo._md5sum)
            return float(GetChargeInfoResponse().deserialize(answer).battery_level)
        except (NotAnnounced, DeserializationError) as error:
            raise NotAnnounced(f"{silent}; and {service}: {error}") from None
    if len(message) != _FLOAT64.size:
        raise NotAnnounced("its messages are no std_msgs/Float64")
    (percent,) = _FLOAT64.unpack(message)
    return float(percent)


def heard_bool(graph: Graph, topic: str) -> TopicSeen:
    return _heard(graph, topic, 1, lambda data: data[:1] == b"\x01")


def heard_text(graph: Graph, topic: str) -> TopicSeen:
    """The newer of two messages: the first may be the latched word of a node that is dead."""

    def text(data: bytes) -> str:
        (length,) = _LENGTH.unpack_from(data)
        return data[_LENGTH.size : _LENGTH.size + length].decode()

    return _heard(graph, topic, 2, text)


def _heard(graph: Graph, topic: str, count: int, read: Callable[[bytes], Any]) -> TopicSeen:
    if not graph.living_publishers(topic):
        return TopicSeen(is_published=False)
    try:
        return TopicSeen(True, read(next_messages(graph, topic, count)[-1]))
    except (NotAnnounced, struct.error, UnicodeDecodeError):
        return TopicSeen(is_published=True)


def charge(graph: Graph, apad: str) -> float | None:
    """The aPad's charge as a fraction; None where nothing tells it, or tells what is no number."""
    try:
        percent = battery_percent(graph, apad)
    except NotAnnounced:
        return None
    return percent / 100 if math.isfinite(percent) else None
