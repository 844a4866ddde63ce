"""Whom an aPad serves at the moment, where there are several: its mission sees the beliefs of these and of no others."""

from __future__ import annotations

from collections.abc import Iterable

from apad_bridge.beliefs.belief import Belief
from apad_bridge.mission.sources import BeliefSource


class Share:
    """A BeliefSource. At first it is the fleet that is simulated beside this mission."""

    def __init__(self, beliefs: BeliefSource, own: Iterable[int]) -> None:
        self._beliefs = beliefs
        self.own = frozenset(own)
        self.served = self.own

    @property
    def guests(self) -> frozenset[int]:
        """Of another fleet, and served here."""
        return self.served - self.own

    @property
    def given(self) -> frozenset[int]:
        """Of this fleet, and served elsewhere."""
        return self.own - self.served

    def take(self, agent_id: int) -> None:
        self.served |= {agent_id}

    def give(self, agent_id: int) -> None:
        self.served -= {agent_id}

    def get(self, agent_id: int) -> Belief | None:
        """Of one that is served elsewhere too: a dock may hold it still."""
        return self._beliefs.get(agent_id)

    def all(self) -> list[Belief]:
        beliefs = self._beliefs.all()
        if self.served == self.own:
            return beliefs
        return [belief for belief in beliefs if belief.agent_id in self.served]
