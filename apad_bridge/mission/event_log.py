"""What happened since a script last asked: from the port's outcomes, and from beliefs that changed."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable

from apad_bridge.beliefs.belief import Belief
from apad_bridge.mission.values import KINDS, Event, Refused, Status
from firmware_model.states import State

KEPT = 10_000
"""Of events that nobody asks for, the oldest are forgotten beyond so many."""


class EventLog:
    def __init__(self, low: float) -> None:
        self._low = low
        self._events: deque[Event] = deque(maxlen=KEPT)
        self.failure: str | None = None
        """Why a primitive failed last."""
        self._seen: dict[int, tuple[State, bool]] = {}

    def tell(
        self,
        now_ms: int,
        kind: str,
        agent: int | None = None,
        dock: int | None = None,
        status: Status | None = None,
        reason: str | None = None,
    ) -> None:
        if status is Status.FAILED:
            self.failure = reason
        self._events.append(Event(now_ms / 1000, kind, agent, dock, status, reason))

    def look(self, beliefs: Iterable[Belief], now_ms: int) -> None:
        """Compares with what was believed at the last look."""
        for belief in beliefs:
            now = (belief.state, belief.primary <= self._low)
            before = self._seen.get(belief.agent_id)
            if before == now:
                continue
            self._seen[belief.agent_id] = now
            if before is None:
                self.tell(now_ms, "heard", belief.agent_id)
            elif before[0] is not now[0]:
                self.tell(now_ms, "state", belief.agent_id, reason=now[0].name)
            if now[1] and (before is None or not before[1]):
                self.tell(now_ms, "low", belief.agent_id)

    def take(self, kind: str | None = None, agent: int | None = None) -> list[Event]:
        """The events of a kind and an aMussel (None: of all), which are then forgotten; the others stay."""
        _refuse_unknown(kind)
        wanted: list[Event] = []
        left: list[Event] = []
        for event in self._events:
            (wanted if kind in (None, event.kind) and agent in (None, event.agent) else left).append(event)
        self._events = deque(left, maxlen=KEPT)
        return wanted

    def take_first(self, kind: str | None = None, agent: int | None = None) -> Event | None:
        """The oldest such event, which is then forgotten."""
        _refuse_unknown(kind)
        for event in self._events:
            if kind in (None, event.kind) and agent in (None, event.agent):
                self._events.remove(event)
                return event
        return None


def _refuse_unknown(kind: str | None) -> None:
    if kind is not None and kind not in KINDS:
        raise Refused(f"there are no events {kind!r}: the kinds are {', '.join(KINDS)}")
