"""Repeats to aMussels that nobody comes for that they may sink: at the surface one spends most of its charge."""

from __future__ import annotations

from collections.abc import Container, Iterable

from agents.time_scale import MissionMs
from apad_bridge.beliefs.belief import Belief
from firmware_model.state_groups import UP_AND_UNDOCKED


class SinkReminders:
    """Selects aMussels at the surface that nobody comes for, to be told every `repeat_ms` that they may sink."""

    def __init__(self, repeat_ms: int) -> None:
        self._repeat_ms = repeat_ms
        self._reminded_ms: dict[int, int] = {}

    def take_due(
        self,
        beliefs: Iterable[Belief],
        expected: Container[int],
        called_up: Container[int],
        now_ms: MissionMs,
    ) -> list[int]:
        """The ids of `due`, which are told now."""
        due_ids = self.due(beliefs, expected, called_up, now_ms)
        self._reminded_ms.update(dict.fromkeys(due_ids, now_ms))
        return due_ids

    def due(
        self,
        beliefs: Iterable[Belief],
        expected: Container[int],
        called_up: Container[int],
        now_ms: MissionMs,
    ) -> list[int]:
        """The ids to tell now: heard at the surface at this very time, not `expected` there, not told of late.

        An aMussel that was told at its release and is still at the surface did not get the message, because a
        board asleep in its dock has its Wi-Fi off.

        An empty aMussel is told only if it was `called_up`. Any other came up to survive, and can be fetched there.
        """
        return [
            belief.agent_id
            for belief in beliefs
            if belief.state in UP_AND_UNDOCKED
            and (belief.primary > 0 or belief.agent_id in called_up)
            and belief.agent_id not in expected
            and belief.heard_ms == now_ms
            and now_ms - self._reminded_ms.get(belief.agent_id, now_ms - self._repeat_ms) >= self._repeat_ms
        ]
