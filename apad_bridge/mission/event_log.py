"""Keeps events for scripts until they take them: from the port's outcomes and from changed beliefs."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable

from agents.time_scale import MissionMs
from apad_bridge.beliefs.belief import Belief
from apad_bridge.mission.values import Refused, ScriptEvent, ScriptEventKind, Status
from firmware_model.states import State

MAX_EVENTS = 10_000
"""The log forgets the oldest events beyond so many."""


class EventLog:
    def __init__(self, low: float) -> None:
        self._low = low
        self._events: deque[ScriptEvent] = deque(maxlen=MAX_EVENTS)
        self.failure: str | None = None
        """The reason of the last failed primitive."""
        self._seen: dict[int, tuple[State, bool]] = {}

    def record(
        self,
        now_ms: MissionMs,
        kind: ScriptEventKind,
        agent: int | None = None,
        dock: int | None = None,
        status: Status | None = None,
        reason: str | None = None,
    ) -> None:
        if status is Status.FAILED:
            self.failure = reason
        self._events.append(ScriptEvent(now_ms / 1000, kind, agent, dock, status, reason))

    def compare(self, beliefs: Iterable[Belief], now_ms: MissionMs) -> None:
        """Compares the beliefs with the beliefs of the last call and records the changes."""
        for belief in beliefs:
            now = (belief.state, belief.primary <= self._low)
            before = self._seen.get(belief.agent_id)
            if before == now:
                continue
            self._seen[belief.agent_id] = now
            if before is None:
                self.record(now_ms, ScriptEventKind.HEARD, belief.agent_id)
            elif before[0] is not now[0]:
                self.record(now_ms, ScriptEventKind.STATE, belief.agent_id, reason=now[0].name)
            if now[1] and (before is None or not before[1]):
                self.record(now_ms, ScriptEventKind.LOW, belief.agent_id)

    def take(self, kind: str | None = None, agent: int | None = None) -> list[ScriptEvent]:
        """Removes and returns the events of a kind and an aMussel (None: of all); the others stay."""
        _refuse_unknown(kind)
        wanted: list[ScriptEvent] = []
        remaining: list[ScriptEvent] = []
        for event in self._events:
            (wanted if kind in (None, event.kind) and agent in (None, event.agent) else remaining).append(
                event
            )
        self._events = deque(remaining, maxlen=MAX_EVENTS)
        return wanted

    def take_first(self, kind: str | None = None, agent: int | None = None) -> ScriptEvent | None:
        """Removes and returns the oldest such event."""
        _refuse_unknown(kind)
        for event in self._events:
            if kind in (None, event.kind) and agent in (None, event.agent):
                self._events.remove(event)
                return event
        return None


def _refuse_unknown(kind: str | None) -> None:
    if kind is not None and kind not in list(ScriptEventKind):
        raise Refused(f"there are no events {kind!r}: the kinds are {', '.join(ScriptEventKind)}")
