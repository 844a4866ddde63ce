"""Sources of a mission's beliefs, which give no access to the truth, and the aMussels that one of several aPads serves."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Protocol

from apad_bridge.beliefs.belief import Belief
from apad_bridge.beliefs.fleet_beliefs import Estimator


class BeliefSource(Protocol):
    def get(self, agent_id: int) -> Belief | None: ...

    def all(self) -> list[Belief]:
        """The beliefs about all known aMussels, by id."""


class PredictingBeliefSource(BeliefSource, Protocol):
    @property
    def estimator(self) -> Estimator:
        """The estimator, which predicts beliefs."""


class Allocation:
    """A BeliefSource. At first it allocates the fleet that is simulated beside this mission."""

    def __init__(self, beliefs: BeliefSource, own: Iterable[int]) -> None:
        self._beliefs = beliefs
        self.own = self.served = frozenset(own)
        self.served_for_others: frozenset[int] = frozenset()
        """Another fleet's aMussels, served here."""
        self.served_elsewhere: frozenset[int] = frozenset()
        """This fleet's aMussels, served elsewhere."""
        self.barred: frozenset[int] = frozenset()
        """The aMussels that are served here, and that no dock here may close on for the present."""

    def concerns(self, agent_id: int) -> bool:
        """True for an aMussel of this fleet, whoever serves it, and for one that is served here."""
        return agent_id in self.own or agent_id in self.served

    def take(self, agent_id: int) -> None:
        self._serve(self.served | {agent_id})

    def give(self, agent_id: int) -> None:
        self._serve(self.served - {agent_id})

    def _serve(self, agent_ids: frozenset[int]) -> None:
        self.served = agent_ids
        self.served_for_others, self.served_elsewhere = agent_ids - self.own, self.own - agent_ids

    def get(self, agent_id: int) -> Belief | None:
        """The belief, also about an aMussel served elsewhere: a dock here may still hold it."""
        return self._beliefs.get(agent_id)

    def all(self) -> list[Belief]:
        beliefs = self._beliefs.all()
        if not self.served_for_others and not self.served_elsewhere:
            return beliefs
        return [belief for belief in beliefs if belief.agent_id in self.served]
