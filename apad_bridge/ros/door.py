"""Opens the door to live aPads for the checks (`doctor/live_apad.py`), without a node of ours on the graph."""

from __future__ import annotations

import importlib
import time
from typing import Any

from genpy import DeserializationError

from apad_bridge.doctor.definitions import Md5s, python_md5s
from apad_bridge.doctor.graph_checks import Graph
from apad_bridge.doctor.live_apad import Door, NotAnnounced
from apad_bridge.doctor.positions import PositionSample
from apad_bridge.ros.types.any_message import AnyMessages
from apad_bridge.ros.types.messages import generated_folder, use_generated_messages
from apad_bridge.ros.types.wire_probe import (
    call_without_words,
    messages_within,
    next_messages,
    service_md5,
    stamp_offset_s,
    topic_md5,
)
from apad_bridge.ros.types.workspace_services import service_by_text


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
        at_s=at_s,
        sequence=message.header.seq,
        north_m=message.position.north,
        east_m=message.position.east,
        status=getattr(message, "status", 0),
        north_variance_m2=number("position_variance.north"),
        east_variance_m2=number("position_variance.east"),
        yaw_rad=number("orientation.yaw"),
        stamp_s=message.header.stamp.to_sec(),
        wall_s=wall_s,
        origin_deg=(number("origin.latitude"), number("origin.longitude")),
        global_deg=(number("global_position.latitude"), number("global_position.longitude")),
    )


def answer(graph: Graph, service: str, kind: str) -> Any:
    """The response of a service whose request is empty. NotAnnounced for none, or for one that cannot be read."""
    use_generated_messages()
    package, name = kind.split("/")
    ours = getattr(importlib.import_module(f"{package}.srv"), name)
    try:
        return ours._response_class().deserialize(call_without_words(graph, service, ours._md5sum))
    except DeserializationError as error:
        raise NotAnnounced(str(error)) from None


def _our_md5s() -> Md5s:
    return python_md5s(generated_folder(), ("apad", "auv_msgs", "misc_msgs", "navcon_msgs"))


DOOR = Door(
    topic_md5=topic_md5,
    service_md5=service_md5,
    messages=next_messages,
    stamp_offsets_s=stamp_offset_s,
    positions=positions,
    answer=answer,
    our_md5s=_our_md5s,
    is_by_text=lambda kind, md5: service_by_text(kind, md5) is not None,
)
