"""A queue from rospy's threads to the one thread that owns the flight."""

from __future__ import annotations

import threading
from collections import Counter
from typing import Generic, TypeVar

Item = TypeVar("Item")

CAPACITY = 20_000
"""Two minutes of an aPad that holds four aMussels. In a longer stall the newest telemetry is lost, and counted."""


class Inbox(Generic[Item]):
    """In order of arrival. A full inbox accepts only `always` items: there are as many of them as commands."""

    def __init__(self, capacity: int = CAPACITY) -> None:
        self._dropped: Counter[str] = Counter()
        self._capacity = capacity
        self._items: list[Item] = []
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

    def take(self, wait_s: float = 0.0) -> list[Item]:
        """All items. An empty inbox waits up to `wait_s` wall seconds for the first."""
        with self._arrived:
            if not self._items and wait_s > 0:
                self._arrived.wait(wait_s)
            items, self._items = self._items, []
            return items
