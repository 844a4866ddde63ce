"""An aMussel heard at the surface that nobody comes for: it is told that it may sink, and told again."""

from __future__ import annotations

from collections.abc import Container, Iterable

from apad_bridge.beliefs.belief import Belief
from firmware_model.state_groups import UP_AND_UNDOCKED


class Strays:
    def __init__(self, repeat_ms: int) -> None:
        self._repeat_ms = repeat_ms
        self._told_ms: dict[int, int] = {}

    def to_tell(self, beliefs: Iterable[Belief], expected: Container[int], now_ms: int) -> list[int]:
        """Ids to tell now, to be told: heard at this very time at the surface, not `expected` there, not told of late.

        One that was told at its release and is heard up there did not get the word, for a board asleep in its dock has its
        Wi-Fi off.

        An empty one is not told: it came up for its life, or would be as empty below, and can be fetched where it is.
        """
        found = [
            belief.agent_id
            for belief in beliefs
            if belief.state in UP_AND_UNDOCKED
            and belief.primary > 0
            and belief.agent_id not in expected
            and belief.heard_ms == now_ms
            and now_ms - self._told_ms.get(belief.agent_id, now_ms - self._repeat_ms) >= self._repeat_ms
        ]
        self._told_ms.update(dict.fromkeys(found, now_ms))
        return found
