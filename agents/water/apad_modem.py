"""The aPad's own modem as its queue: one sound at a time, and silence while the answer to a ping is awaited. Agent time."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

from agents.modem.frames import Frame, FrameKind

ANSWER_TIMEOUT_MS = 4000
"""The modem's own: then a ping is taken for unanswered."""
_ROOM = 256


@dataclass(frozen=True, slots=True)
class Send:
    at_ms: int
    node: int | None
    """Whom it is for, which an address may not tell; None for everyone."""
    frame: Frame


@dataclass(frozen=True, slots=True)
class Unanswered:
    """The ping for `node` was not answered in time."""

    at_ms: int
    node: int | None


class APadModem:
    """Three verbs. What it is asked to send goes out in the order of asking."""

    def __init__(self, now_ms: int = 0) -> None:
        self._waiting: deque[tuple[int, int | None, Frame]] = deque()
        """(not before, whom for, what)."""
        self._now_ms = now_ms
        self._free_ms = now_ms
        self._asked: int | None = None
        """The node whose answer is awaited, until `_free_ms`."""

    @property
    def next_due_ms(self) -> int | None:
        if self._asked is not None:
            return self._free_ms
        return max(self._free_ms, self._waiting[0][0]) if self._waiting else None

    def advance(self, now_ms: int) -> list[Send | Unanswered]:
        """What it sends up to `now_ms` (ValueError if time went back)."""
        if now_ms < self._now_ms:
            raise ValueError(f"time went back: {now_ms} before {self._now_ms}")
        done: list[Send | Unanswered] = []
        while (due_ms := self.next_due_ms) is not None and due_ms <= now_ms:
            at_ms = max(due_ms, self._now_ms)
            self._now_ms = at_ms
            if self._asked is not None:
                done.append(Unanswered(at_ms, self._asked))
                self._asked = None
                continue
            _, node, frame = self._waiting.popleft()
            self._free_ms = at_ms + frame.duration_ms
            if frame.kind is FrameKind.PING:
                self._asked = node
                self._free_ms += ANSWER_TIMEOUT_MS
            done.append(Send(at_ms, node, frame))
        self._now_ms = now_ms
        return done

    def ask(self, node: int | None, frame: Frame, not_before_ms: int = 0) -> bool:
        """Queues a frame, to be sent then or later; False if there is no room, and it is dropped."""
        if len(self._waiting) >= _ROOM:
            return False
        self._waiting.append((not_before_ms, node, frame))
        return True

    def answered(self, node: int, now_ms: int) -> bool:
        """An answer of `node` came; whether it was awaited."""
        if self._asked != node:
            return False
        self._asked = None
        self._free_ms = now_ms
        return True
