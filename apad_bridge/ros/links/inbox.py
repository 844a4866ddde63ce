"""Where rospy's threads leave what they heard, for the one thread that owns the flight."""

from __future__ import annotations

import threading
from collections import Counter
from typing import Generic, TypeVar

Item = TypeVar("Item")

CAPACITY = 20_000
"""Two minutes of an aPad that carries four. A flight that stalls for longer loses the newest telemetry, and counts it."""


class Inbox(Generic[Item]):
    """In order of arrival. Only `always` items go in when it is full: there are as many of them as commands."""

    def __init__(self, capacity: int = CAPACITY) -> None:
        self._dropped: Counter[str] = Counter()
        self._capacity = capacity
        self._items: list[Item] = []
        self._came = threading.Condition()

    @property
    def dropped(self) -> Counter[str]:
        """So far, by reason: a copy, for rospy's threads go on counting."""
        with self._came:
            return self._dropped.copy()

    def put(self, item: Item, *, always: bool = False) -> None:
        with self._came:
            if len(self._items) >= self._capacity and not always:
                self._dropped["telemetry: the flight did not keep up"] += 1
                return
            self._items.append(item)
            self._came.notify_all()

    def drop(self, reason: str) -> None:
        """Counts what could not even be put in."""
        with self._came:
            self._dropped[reason] += 1

    def take(self, wait_s: float = 0.0) -> list[Item]:
        """All that is there; when nothing is, what comes first within `wait_s` wall seconds."""
        with self._came:
            if not self._items and wait_s > 0:
                self._came.wait(wait_s)
            items, self._items = self._items, []
            return items
