"""A queue from rospy's threads to the one thread that owns the flight."""

from __future__ import annotations

import threading
from collections import Counter
from typing import Any, Generic, TypeVar

from apad_bridge.events.event import Event
from apad_bridge.events.graph_events import MessagesDropped

Item = TypeVar("Item")

CAPACITY = 20_000
"""Two minutes of an aPad that holds four aMussels. In a longer stall the newest telemetry is lost, and counted."""
_MOST_REPORTED = 50
"""Publishers with unreadable messages that are reported; the messages of others are counted alone."""


class Inbox(Generic[Item]):
    """In order of arrival. A full inbox accepts only `always` items: there are as many of them as commands."""

    def __init__(self, capacity: int = CAPACITY) -> None:
        self._dropped: Counter[str] = Counter()
        self._capacity = capacity
        self._items: list[Item] = []
        self._reported: set[tuple[str, str]] = set()
        """The topics, and the nodes whose messages on them could not be read."""
        self._events: list[Event] = []
        self._arrived = threading.Condition()

    @property
    def dropped(self) -> Counter[str]:
        """A copy by reason, because rospy's threads go on counting."""
        with self._arrived:
            return self._dropped.copy()

    def put(self, item: Item, *, always: bool = False) -> None:
        with self._arrived:
            if len(self._items) >= self._capacity and not always:
                self._dropped["telemetry: the flight did not keep up"] += 1
                return
            self._items.append(item)
            self._arrived.notify_all()

    def drop(self, reason: str) -> None:
        """Counts a message that could not be put in."""
        with self._arrived:
            self._dropped[reason] += 1

    def refuse(self, topic: str, node: str, why: str) -> None:
        """Counts a message that its reader cannot use, and has each such publisher reported once."""
        with self._arrived:
            self._dropped[f"{topic}: {why}"] += 1
            if (topic, node) in self._reported or len(self._reported) >= _MOST_REPORTED:
                return
            self._reported.add((topic, node))
            self._events.append(MessagesDropped(topic, node, why))

    def take_events(self) -> list[Event]:
        """The publishers refused since the last call."""
        with self._arrived:
            events, self._events = self._events, []
            return events

    def take(self, wait_s: float = 0.0) -> list[Item]:
        """All items. An empty inbox waits up to `wait_s` wall seconds for the first."""
        with self._arrived:
            if not self._items and wait_s > 0:
                self._arrived.wait(wait_s)
            items, self._items = self._items, []
            return items


class Listening(Generic[Item]):
    """Subscribers that leave messages in an inbox, and the counts of what was dropped of them."""

    def __init__(self) -> None:
        self._inbox: Inbox[Item] = Inbox()
        self._dropped: Counter[str] = Counter()
        """Those of the flight's thread; the inbox has those of rospy's threads."""
        self._subscribers: list[Any] = []
        """Subscribers and publishers to unregister at the end."""

    @property
    def dropped(self) -> Counter[str]:
        return self._dropped + self._inbox.dropped

    def take_events(self) -> list[Event]:
        """Publishers whose messages cannot be read, each once."""
        return self._inbox.take_events()

    def close(self) -> None:
        for subscriber in self._subscribers:
            subscriber.unregister()
