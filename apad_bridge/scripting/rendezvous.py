"""How a script's thread and the supervisor's take turns: never both at once, and neither waits without end.

The script runs between two asks; whatever it asks is done by the supervisor's thread, inside the mission's tick, while the
script stands still. So a tick does not end before the script has blocked (in a sleep or a wait), and an `asap` flight is
the same every time. A script that computes for longer than the stated times does not stop the world: see `Turns`.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

_LOOK_S = 0.5
NO_TICK_S = 60.0
"""A script that hears of no mission tick for so long is ended: the supervisor is gone."""


class Aborted(BaseException):
    """The mission is over. Not an Exception, so that a script's own `except Exception` does not swallow it."""


@dataclass(frozen=True, slots=True)
class Turns:
    """Wall seconds. A tick waits `tick_s` for the script; after `busy_s` without an ask the mission ends."""

    tick_s: float
    busy_s: float


AS_FAST_AS_POSSIBLE = Turns(tick_s=30.0, busy_s=30.0)
"""Virtual time waits for the script: it is that, or another flight each time."""
REAL_TIME = Turns(tick_s=0.2, busy_s=30.0)
"""A tick is late by this at most; a script that is not done then has its next ask heard at a later tick."""


@dataclass(frozen=True, slots=True)
class Do:
    """Asked by the script: answered at once."""

    act: Callable[[], Any]


@dataclass(frozen=True, slots=True)
class Wait:
    """Asked by the script: answered True when `condition` holds at a tick, False when mission time is `until_ms`."""

    condition: Callable[[], bool] | None
    until_ms: int


Ask = Do | Wait


@dataclass(frozen=True, slots=True)
class Finished:
    """The script is over; `failure` is why, in one line, when it did not just end."""

    failure: str | None


class Rendezvous:
    """`ask` and `finish` are for the script's thread, the rest for the supervisor's."""

    def __init__(self, turns: Turns) -> None:
        self._turns = turns
        self._lock = threading.Condition()
        self._ask: Ask | Finished | None = None
        self._answer: Any = None
        self._closed: str | None = None
        self._tick_s = self._answered_s = time.monotonic()
        self._supervisor = threading.current_thread()
        self._script: threading.Thread | None = None

    # The script's side.

    def ask(self, ask: Ask) -> Any:
        """Hands the ask over and stands still until it is answered. Aborted when the mission is over."""
        if threading.current_thread() is self._supervisor:
            if isinstance(ask, Wait):
                raise RuntimeError("a condition may look and order, but neither sleep nor wait")
            return ask.act()
        with self._lock:
            if self._script is None:
                self._script = threading.current_thread()
            if self._script is not threading.current_thread():
                raise RuntimeError(
                    "the API is for the script's own thread: let the others hand it what they found"
                )
            self._ask = ask
            self._lock.notify_all()
            while self._ask is ask and self._closed is None:
                self._lock.wait(_LOOK_S)
                if time.monotonic() - self._tick_s > NO_TICK_S or not self._supervisor.is_alive():
                    self._closed = f"no mission tick came for {NO_TICK_S:g} s"
            if self._ask is ask:
                raise Aborted(self._closed)
            answer, self._answer = self._answer, None
        if isinstance(answer, BaseException):
            raise answer
        return answer

    def finish(self, failure: str | None) -> None:
        with self._lock:
            self._ask = Finished(failure)
            self._lock.notify_all()

    # The supervisor's side.

    def begin(self) -> None:
        """The script is about to start; the calling thread is the supervisor's."""
        self._supervisor = threading.current_thread()
        self._tick_s = self._answered_s = time.monotonic()

    def tick(self) -> None:
        """A mission tick has begun."""
        with self._lock:
            self._tick_s = time.monotonic()
            if self._ask is not None:
                self._answered_s = self._tick_s

    def next(self) -> Ask | Finished | None:
        """What the script asks; None when it computes for longer than this tick waits for it."""
        with self._lock:
            self._lock.wait_for(lambda: self._ask is not None, self._turns.tick_s)
            return self._ask

    @property
    def is_stuck(self) -> bool:
        """Whether the script has computed for longer than it may."""
        return self._ask is None and time.monotonic() - self._answered_s >= self._turns.busy_s

    @property
    def busy_s(self) -> float:
        return self._turns.busy_s

    def answer(self, answer: Any) -> None:
        """Lets the script go on; an exception is raised in it."""
        with self._lock:
            self._answer, self._ask = answer, None
            self._answered_s = time.monotonic()
            self._lock.notify_all()

    def close(self, reason: str) -> None:
        """The mission is over: whatever the script asks from now on raises Aborted."""
        with self._lock:
            self._closed = reason
            self._lock.notify_all()
