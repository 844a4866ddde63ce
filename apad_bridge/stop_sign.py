"""A sign to stop that a signal handler may set.

threading.Event may not be set by one: a handler runs in the middle of whatever its own thread does, and when that is the
first step of a wait, the handler waits for a lock that only its own thread could release. This one's lock is re-entrant.
A sign that is set in that very moment is seen when the wait's time is over, not before: so every wait has one.
"""

from __future__ import annotations

import threading
from typing import Protocol


class Stopped(Protocol):
    """What a waiting thread needs of the sign."""

    def is_set(self) -> bool: ...

    def wait(self, timeout_s: float, /) -> bool:
        """Whether it was set within `timeout_s` wall seconds."""
        ...


class StopSign:
    def __init__(self) -> None:
        self._wake = threading.Condition(threading.RLock())
        self._is_set = False

    def set(self) -> None:
        self._is_set = True
        with self._wake:
            self._wake.notify_all()

    def is_set(self) -> bool:
        return self._is_set

    def wait(self, timeout_s: float, /) -> bool:
        with self._wake:
            if not self._is_set:
                self._wake.wait(timeout_s)
        return self._is_set
