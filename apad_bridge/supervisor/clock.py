"""What lets mission time pass: as fast as the machine goes, or not before its wall-clock time.

A sign to stop that a signal handler may set.

threading.Event may not be set by one: a handler runs in the middle of whatever its own thread does, and when that is the
first step of a wait, the handler waits for a lock that only its own thread could release. This one's lock is re-entrant.
A sign that is set in that very moment is seen when the wait's time is over, not before: so every wait has one.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
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


Between = Callable[[int], None]
"""Told a mission time that has come, on the way to the next tick."""

BEAT_S = 0.03
"""Wall seconds between two such words: what talks to a serial line is not kept waiting for a tick."""


class Pace(Protocol):
    def reach(self, now_ms: int, stopped: Stopped, between: Between | None = None) -> None:
        """Returns when mission time `now_ms` has come for everybody, or at once when `stopped` is set.

        Calls `between` on the way, about every `BEAT_S`, with times before `now_ms` that have come; one that has no wall
        clock does not.

        TimeoutError, saying who, when somebody whose word is waited for does not give it in the stated time.
        """
        ...

    @property
    def behind_s(self) -> float:
        """How many wall seconds the flight is behind its time; 0 when it keeps up."""
        ...


class AsFastAsPossible:
    behind_s = 0.0

    def reach(self, now_ms: int, stopped: Stopped, between: Between | None = None) -> None:
        pass


class WallClock:
    """Mission time runs `speed` times as fast as the wall clock, from where it stood at the first call.

    A flight that falls more than `bound_s` behind does not try to make that up: the schedule moves, and `slipped_s` says
    by how much in all.
    """

    def __init__(
        self, speed: float, bound_s: float = 5.0, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._speed = speed
        self._bound_s = bound_s
        self._clock = clock
        self._origin: tuple[int, float] | None = None
        self.behind_s = 0.0
        self.slipped_s = 0.0

    def reach(self, now_ms: int, stopped: Stopped, between: Between | None = None) -> None:
        now_s = self._clock()
        if self._origin is None:
            self._origin = (now_ms, now_s)
        start_ms, start_s = self._origin
        due_s = start_s + (now_ms - start_ms) / 1000 / self._speed
        if due_s > now_s:
            self.behind_s = 0.0
            while due_s > now_s and not stopped.wait(
                min(due_s - now_s, BEAT_S) if between else due_s - now_s
            ):
                now_s = self._clock()
                come_ms = start_ms + int((now_s - start_s) * 1000 * self._speed)
                if between is not None and come_ms < now_ms:
                    between(come_ms)
                    now_s = self._clock()
            return
        self.behind_s = now_s - due_s
        if self.behind_s > self._bound_s:
            self.slipped_s += self.behind_s
            self._origin = (start_ms, start_s + self.behind_s)
