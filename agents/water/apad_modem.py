"""The queue of the aPad's own modem: one sound at a time, and silence while a ping waits for its answer. Agent time."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

from agents.modem.frames import FrameKind, ModemFrame

ANSWER_TIMEOUT_MS = 4000
"""The modem's own time-out, after which a ping counts as unanswered."""
_CAPACITY = 256


@dataclass(frozen=True, slots=True)
class ModemSend:
    at_ms: int
    node: int | None
    """The receiving node, because several nodes may share an address; None for everyone."""
    frame: ModemFrame


@dataclass(frozen=True, slots=True)
class Unanswered:
    """The ping for `node` was not answered in time."""

    at_ms: int
    node: int | None


class APadModem:
    """The three verbs. It sends frames in the order in which they were queued."""

    def __init__(self, now_ms: int = 0) -> None:
        self._waiting: deque[tuple[int, int | None, ModemFrame]] = deque()
        """(not before, receiver, frame)."""
        self._now_ms = now_ms
        self._free_ms = now_ms
        self._pinged: int | None = None
        """The node with an unanswered ping, until `_free_ms`."""

    @property
    def next_due_ms(self) -> int | None:
        if self._pinged is not None:
            return self._free_ms
        return max(self._free_ms, self._waiting[0][0]) if self._waiting else None

    def advance(self, now_ms: int) -> list[ModemSend | Unanswered]:
        """Sends everything due by `now_ms` (ValueError if time went back)."""
        if now_ms < self._now_ms:
            raise ValueError(f"time went back: {now_ms} before {self._now_ms}")
        events: list[ModemSend | Unanswered] = []
        while (due_ms := self.next_due_ms) is not None and due_ms <= now_ms:
            at_ms = max(due_ms, self._now_ms)
            self._now_ms = at_ms
            if self._pinged is not None:
                events.append(Unanswered(at_ms, self._pinged))
                self._pinged = None
                continue
            _, node, frame = self._waiting.popleft()
            self._free_ms = at_ms + frame.duration_ms
            if frame.kind is FrameKind.PING:
                self._pinged = node
                self._free_ms += ANSWER_TIMEOUT_MS
            events.append(ModemSend(at_ms, node, frame))
        self._now_ms = now_ms
        return events

    def ask(self, node: int | None, frame: ModemFrame, not_before_ms: int = 0) -> bool:
        """Queues a frame, to be sent then or later; drops it and returns False if there is no room."""
        if len(self._waiting) >= _CAPACITY:
            return False
        self._waiting.append((not_before_ms, node, frame))
        return True

    def forget(self, node: int) -> None:
        """Drops the frames that wait for this node."""
        self._waiting = deque(it for it in self._waiting if it[1] != node)

    def answered(self, node: int, now_ms: int) -> bool:
        """Takes an answer of `node`; False if no ping waited for it."""
        if self._pinged != node:
            return False
        self._pinged = None
        self._free_ms = now_ms
        return True
