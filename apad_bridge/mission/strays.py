"""An aMussel heard at the surface that nobody comes for: it is told that it may sink, and told again."""

from __future__ import annotations

from collections.abc import Container, Iterable

from apad_bridge.beliefs.belief import Belief
from firmware_model.state_groups import UP_AND_UNDOCKED


class Strays:
    def __init__(self, repeat_ms: int) -> None:
        self._repeat_ms = repeat_ms
        self._told_ms: dict[int, int] = {}

    def told(self, agent_id: int, now_ms: int) -> None:
        """It has just been told by somebody."""
        self._told_ms[agent_id] = now_ms

    def to_tell(self, beliefs: Iterable[Belief], expected: Container[int], now_ms: int) -> list[int]:
        """Ids to tell now: heard at this very time at the surface, not `expected` there, and not told of late."""
        return [
            belief.agent_id
            for belief in beliefs
            if belief.state in UP_AND_UNDOCKED
            and belief.agent_id not in expected
            and belief.heard_ms == now_ms
            and now_ms - self._told_ms.get(belief.agent_id, now_ms - self._repeat_ms) >= self._repeat_ms
        ]
