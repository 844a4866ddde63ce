"""Subscribes to and publishes a laboratory's own topics, of any type, by the names of a `Names`."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import rospy

from apad_bridge.ros.system.inbox import Listening
from apad_bridge.ros.system.ros_time import stamp
from apad_bridge.ros.types.any_listener import node_of
from apad_bridge.ros.types.any_message import AnyMessages, UnknownType, class_of
from apad_bridge.ros.types.workspace_services import text_folders
from apad_bridge.scenario.lab_interface.fields import read, write
from apad_bridge.scenario.lab_interface.lab_messages import (
    ClearanceMessage,
    DockReport,
    LaboratoryMessage,
    LaboratoryPacket,
    MessageKind,
)
from apad_bridge.scenario.lab_interface.lab_names import Names, Publication, Subscription
from apad_bridge.vehicle.link_errors import VehicleNotReady

_QUEUE = 100
_LARGEST = 1024
"""Bytes; no packet of Wi-Fi or sound here comes near it."""


class LaboratorySubscribers(Listening[tuple[Subscription, int | None, Any]]):
    """rospy's threads leave raw messages in an inbox; `take` decodes and interprets them."""

    def __init__(self, names: Names, apad: str, agent_ids: Iterable[int]) -> None:
        super().__init__()
        ids = list(agent_ids)
        self._known = frozenset(ids)
        self._messages = AnyMessages()
        self._subscribers = [
            rospy.Subscriber(topic, rospy.AnyMsg, self._take, (subscription, agent_id), tcp_nodelay=True)
            for subscription in names.hear
            for topic, agent_id in _topics(subscription.topic, apad, ids)
        ]

    def take(self, now_ms: int) -> list[LaboratoryMessage]:
        """The messages since the last call. One that cannot be interpreted is dropped and counted."""
        messages = []
        for subscription, agent_id, raw in self._inbox.take():
            try:
                message = self._interpret(subscription, agent_id, self._messages.decode(raw), now_ms)
            except (AttributeError, IndexError, TypeError, ValueError, KeyError) as error:
                self._inbox.refuse(subscription.topic, node_of(raw), str(error))
                continue
            if message is not None:
                messages.append(message)
        return messages

    def _interpret(
        self, subscription: Subscription, topic_id: int | None, message: Any, now_ms: int
    ) -> LaboratoryMessage | None:
        if subscription.when is not None and not subscription.when.is_met(message):
            return None
        agent_id = topic_id if topic_id is not None else subscription.id_of(message)
        if (subscription.everyone is not None and subscription.everyone.is_met(message)) or (
            agent_id is not None and agent_id < 0
        ):
            agent_id = None
        elif agent_id is not None and agent_id not in self._known:
            self._dropped[f"{subscription.topic}: of an aMussel that is not of this fleet"] += 1
            return None
        if subscription.what in (MessageKind.DOCKED, MessageKind.RELEASED):
            closed = subscription.what is MessageKind.DOCKED
            return DockReport(now_ms, agent_id, subscription.dock_index_of(message), closed)
        if subscription.bytes is None:
            if agent_id is None and subscription.everyone is None:
                self._dropped[f"{subscription.topic}: says no id"] += 1
                return None
            return ClearanceMessage(subscription.what, agent_id)
        content = read(message, subscription.bytes)
        if not isinstance(content, bytes | list | tuple):
            raise TypeError(f"{subscription.bytes} holds no bytes")  # of a number Python makes as many zeros
        data = bytes(content)
        if len(data) > _LARGEST:
            raise ValueError("a packet too large to be one")
        return LaboratoryPacket(subscription.medium, agent_id, data)

    def _take(self, message: Any, source: tuple[Subscription, int | None]) -> None:
        self._inbox.put((*source, message), always=True)


class LaboratoryPublishers:
    """Raises VehicleNotReady when a type is known nowhere, or has no such field."""

    def __init__(self, names: Names, apad: str, agent_ids: Iterable[int]) -> None:
        self._out: dict[MessageKind, list[tuple[Publication, int | None, rospy.Publisher]]] = {}
        ids, folders = list(agent_ids), text_folders()
        kinds: dict[str, Any] = {}
        for publication in names.tell:
            try:
                kind = kinds.setdefault(publication.type, class_of(publication.type, folders))
                _fill(kind(), publication, {"id": 0, "slot": 0, "on": True, "bytes": b""})
            except (UnknownType, AttributeError, TypeError, ValueError) as error:
                raise VehicleNotReady(
                    f"{publication.topic} cannot be told: {error}; see apad.interface"
                ) from error
            for topic, agent_id in _topics(publication.topic, apad, ids):
                publisher = rospy.Publisher(topic, kind, queue_size=_QUEUE)
                self._out.setdefault(publication.what, []).append((publication, agent_id, publisher))

    def publish(
        self,
        what: MessageKind,
        agent_id: int,
        now_ms: int,
        *,
        dock_index: int = -1,
        on: bool = True,
        data: bytes = b"",
    ) -> None:
        for publication, of_agent, publisher in self._out.get(what, ()):
            if of_agent in (None, agent_id):
                message = publisher.data_class()
                _fill(message, publication, {"id": agent_id, "slot": dock_index, "on": on, "bytes": data})
                if getattr(message, "_has_header", False):
                    message.header.stamp = stamp(now_ms)
                publisher.publish(message)

    def close(self) -> None:
        for publishers in self._out.values():
            for _, _, publisher in publishers:
                publisher.unregister()


def _topics(topic: str, apad: str, ids: list[int]) -> list[tuple[str, int | None]]:
    """Names on the graph, each with the id of the aMussel that it names."""
    named = topic.replace("{apad}", apad)
    if "{id}" not in named:
        return [(named, None)]
    return [(named.replace("{id}", str(agent_id)), agent_id) for agent_id in ids]


def _fill(message: Any, publication: Publication, values: dict[str, Any]) -> None:
    for path, template in publication.fields.items():
        value: Any = template
        if isinstance(template, str):
            whole = next((values[name] for name in values if template == f"{{{name}}}"), None)
            value = whole if whole is not None else template.format(**values)
        write(message, path, value)
