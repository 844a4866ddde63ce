"""What a planning strategy is: collection and redeployment, each a single pure question.

A strategy has no clock and no memory that matters: the same situation gives the same plan. Ties are broken by
the lower agent id, and slots are filled in the order in which the situation lists them.
"""

from __future__ import annotations

from collections.abc import Iterable
from math import dist
from typing import Protocol

from apad_bridge.planning.candidates import Candidate, Situation
from apad_bridge.planning.solution import Solution, Step, StepKind


class CollectionStrategy(Protocol):
    """Chooses whom to collect, and in which order."""

    @property
    def plans(self) -> StepKind:
        """StepKind.COLLECT: tells the two sorts of strategy apart in the registry."""

    def plan(self, situation: Situation, batch: int) -> Solution:
        """COLLECT steps for at most `batch` candidates, and for no more than there are free slots."""


class RedeploymentStrategy(Protocol):
    """Chooses the order in which docked agents go back to their homes."""

    @property
    def plans(self) -> StepKind:
        """StepKind.DEPLOY: tells the two sorts of strategy apart in the registry."""

    def plan(self, situation: Situation) -> Solution:
        """A DEPLOY step for each candidate; all of them are docked (`dock_index` is known)."""


def places_to_fill(situation: Situation, batch: int) -> int:
    """How many can be collected at most: the batch, the candidates and the free slots each bound it."""
    if batch < 1:
        raise ValueError(f"batch must be 1 or more, not {batch}")
    return min(batch, len(situation.candidates), len(situation.free_docks))


def collect_in_order(chosen: Iterable[Candidate], situation: Situation) -> Solution:
    """The plan that collects `chosen` in their order, filling the free slots in theirs."""
    pairs = zip(chosen, situation.free_docks, strict=False)
    return Solution(tuple(Step(StepKind.COLLECT, agent.agent_id, dock_index) for agent, dock_index in pairs))


def nearest(place_m: tuple[float, float], points_m: dict[int, tuple[float, float]]) -> int:
    """The agent id whose point is nearest to `place_m` (Euclidean); of equally near ones the lowest id."""
    return min(points_m, key=lambda agent_id: (dist(place_m, points_m[agent_id]), agent_id))
