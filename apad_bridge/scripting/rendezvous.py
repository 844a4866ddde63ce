"""Lets a script's thread and the supervisor's thread take turns: they never run at once, and neither waits for ever.

The script runs between two requests. The supervisor's thread serves each request inside the mission's tick, while the
script stands still. So a tick does not end before the script blocks in a sleep or a wait, and an `asap` flight is the same
every time. A script that computes for longer than the times in `TurnTimeouts` does not stop the flight.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

_CHECK_S = 0.5
NO_TICK_S = 60.0
"""Wall seconds without a mission tick after which a script is ended, because its supervisor is gone."""


class Aborted(BaseException):
    """Raised in the script when the mission is over.

    It is no Exception, so that a script's own `except Exception` does not swallow it.
    """


@dataclass(frozen=True, slots=True)
class TurnTimeouts:
    """Limits in wall seconds: a tick waits `tick_s` for the script; after `busy_s` without a request the mission ends."""

    tick_s: float
    busy_s: float


AS_FAST_AS_POSSIBLE = TurnTimeouts(tick_s=30.0, busy_s=30.0)
"""For virtual time, which waits for the script: otherwise every flight would be another one."""
REAL_TIME = TurnTimeouts(tick_s=0.2, busy_s=30.0)
"""For real time: a tick is late by at most `tick_s`. A slower script has its next request served at a later tick."""


@dataclass(frozen=True, slots=True)
class Do:
    """A request of the script that is served at once."""

    act: Callable[[], Any]


@dataclass(frozen=True, slots=True)
class Wait:
    """A request of the script: answered True when `condition` holds at a tick, False at mission time `until_ms`."""

    condition: Callable[[], bool] | None
    until_ms: int


CallRequest = Do | Wait


@dataclass(frozen=True, slots=True)
class ScriptFinished:
    """The script is over; `failure` is the reason in one line, or None if it simply ended."""

    failure: str | None


class Rendezvous:
    """Hands requests from the script's thread to the supervisor's, and the answers back.

    The script's thread calls `request` and `finish`, the supervisor's all the rest.
    """

    def __init__(self, turns: TurnTimeouts) -> None:
        self._turns = turns
        self._lock = threading.Condition()
        self._request: CallRequest | ScriptFinished | None = None
        self._answer: Any = None
        self._closed: str | None = None
        self._tick_s = self._answered_s = time.monotonic()
        self._supervisor = threading.current_thread()
        self._script: threading.Thread | None = None

    # The script's side.

    def request(self, request: CallRequest) -> Any:
        """Hands the request over and blocks until it is answered. Raises Aborted when the mission is over."""
        if threading.current_thread() is self._supervisor:
            if isinstance(request, Wait):
                raise RuntimeError("a condition may look and order, but neither sleep nor wait")
            return request.act()
        with self._lock:
            if self._script is None:
                self._script = threading.current_thread()
            if self._script is not threading.current_thread():
                raise RuntimeError(
                    "the API is for the script's own thread: let other threads pass their results to it"
                )
            self._request = request
            self._lock.notify_all()
            while self._request is request and self._closed is None:
                self._lock.wait(_CHECK_S)
                if time.monotonic() - self._tick_s > NO_TICK_S or not self._supervisor.is_alive():
                    self._closed = f"no mission tick came for {NO_TICK_S:g} s"
            if self._request is request:
                raise Aborted(self._closed)
            answer, self._answer = self._answer, None
        if isinstance(answer, BaseException):
            raise answer
        return answer

    def finish(self, failure: str | None) -> None:
        with self._lock:
            self._request = ScriptFinished(failure)
            self._lock.notify_all()

    # The supervisor's side.

    def begin(self) -> None:
        """Called before the script starts, in the supervisor's thread."""
        self._supervisor = threading.current_thread()
        self._tick_s = self._answered_s = time.monotonic()

    def tick(self) -> None:
        """Called at the beginning of each mission tick."""
        with self._lock:
            self._tick_s = time.monotonic()
            if self._request is not None:
                self._answered_s = self._tick_s

    def next(self) -> CallRequest | ScriptFinished | None:
        """The script's next request; None when the script computes for longer than this tick waits."""
        with self._lock:
            self._lock.wait_for(lambda: self._request is not None, self._turns.tick_s)
            return self._request

    @property
    def is_stuck(self) -> bool:
        """True when the script has computed for longer than `busy_s`."""
        return self._request is None and time.monotonic() - self._answered_s >= self._turns.busy_s

    @property
    def busy_s(self) -> float:
        return self._turns.busy_s

    def answer(self, answer: Any) -> None:
        """Answers the request, and the script continues; an exception is raised in the script."""
        with self._lock:
            self._answer, self._request = answer, None
            self._answered_s = time.monotonic()
            self._lock.notify_all()

    def close(self, reason: str) -> None:
        """Called when the mission is over: every later request of the script raises Aborted."""
        with self._lock:
            self._closed = reason
            self._lock.notify_all()
