"""Sources of a mission's beliefs. They give no access to the truth."""

from __future__ import annotations

from typing import Protocol

from apad_bridge.beliefs.belief import Belief
from apad_bridge.beliefs.fleet import Estimator


class BeliefSource(Protocol):
    def get(self, agent_id: int) -> Belief | None: ...

    def all(self) -> list[Belief]:
        """The beliefs about all known aMussels, by id."""
        ...


class PredictingBeliefSource(BeliefSource, Protocol):
    @property
    def estimator(self) -> Estimator:
        """The estimator, which predicts beliefs."""
        ...
