"""Where a mission's knowledge comes from. There is no way from here to the truth."""

from __future__ import annotations

from typing import Protocol

from apad_bridge.beliefs.belief import Belief
from apad_bridge.beliefs.fleet import Estimator


class BeliefSource(Protocol):
    def get(self, agent_id: int) -> Belief | None: ...

    def all(self) -> list[Belief]:
        """Every aMussel that anything is believed of, by id."""
        ...


class Foretelling(BeliefSource, Protocol):
    @property
    def estimator(self) -> Estimator:
        """Which carries beliefs on."""
        ...
