"""Where a mission's knowledge comes from. There is no way from here to the truth."""

from __future__ import annotations

from typing import Protocol

from apad_bridge.beliefs.belief import Belief


class BeliefSource(Protocol):
    def get(self, agent_id: int) -> Belief | None: ...

    def all(self) -> list[Belief]:
        """Every aMussel that anything is believed of, by id."""
        ...
