"""Whom an aPad serves at the moment, where there are several: its mission sees the beliefs of these and of no others."""

from __future__ import annotations

from collections.abc import Iterable

from apad_bridge.beliefs.belief import Belief
from apad_bridge.mission.sources import BeliefSource


class Allocation:
    """A BeliefSource. At first it is the fleet that is simulated beside this mission."""

    def __init__(self, beliefs: BeliefSource, own: Iterable[int]) -> None:
        self._beliefs = beliefs
        self.own = self.served = frozenset(own)
        self.served_for_others: frozenset[int] = frozenset()
        """Of another fleet, and served here."""
        self.served_elsewhere: frozenset[int] = frozenset()
        """Of this fleet, and served elsewhere."""

    def take(self, agent_id: int) -> None:
        self._serve(self.served | {agent_id})

    def give(self, agent_id: int) -> None:
        self._serve(self.served - {agent_id})

    def _serve(self, agent_ids: frozenset[int]) -> None:
        self.served = agent_ids
        self.served_for_others, self.served_elsewhere = agent_ids - self.own, self.own - agent_ids

    def get(self, agent_id: int) -> Belief | None:
        """Of one that is served elsewhere too: a dock may hold it still."""
        return self._beliefs.get(agent_id)

    def all(self) -> list[Belief]:
        beliefs = self._beliefs.all()
        if not self.served_for_others and not self.served_elsewhere:
            return beliefs
        return [belief for belief in beliefs if belief.agent_id in self.served]
