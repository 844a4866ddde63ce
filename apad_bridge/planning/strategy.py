"""The interfaces of planning strategies, each one pure function, and the dock that each step of a plan gets.

A strategy has no clock and no memory that matters: the same situation gives the same plan. The lower agent id breaks
ties, and docks are filled in the order in which the situation lists them.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from math import dist

from apad_bridge.planning.candidates import Candidate, Situation
from apad_bridge.planning.explanation import Option
from apad_bridge.planning.solution import Solution, Step, StepKind


class Strategy:
    """The common part of both sorts. A class of a user's need not derive: the registry adds the members that it lacks."""

    plans: StepKind
    """The sort of strategy."""

    def explain(self, situation: Situation, solution: Solution) -> Sequence[Option]:
        """Returns the reasons of a plan: the plan itself first, and its runner-up second; nothing without reasons."""
        return ()


class CollectionStrategy(Strategy):
    """Chooses the agents to collect, and their order."""

    plans = StepKind.COLLECT
    pre_empts = False
    """True if the mission plans the rest of a batch anew after each docking."""

    def plan(self, situation: Situation, batch: int) -> Solution:
        """Returns COLLECT steps for at most `batch` candidates, and for no more than there are free docks."""
        raise NotImplementedError

    def refuses(self, situation: Situation) -> bool:
        """True if it refuses the whole pool, and will until another aMussel joins it.

        Falling charges and time may end that, and places may not. A study then skips the time until the end.
        """
        return False


class RedeploymentStrategy(Strategy):
    """Chooses the order in which docked agents go back to their homes."""

    plans = StepKind.DEPLOY

    def plan(self, situation: Situation) -> Solution:
        """Returns a DEPLOY step for each candidate; all of them are docked (`dock_index` is known)."""
        raise NotImplementedError


def docks_to_fill(situation: Situation, batch: int) -> int:
    """Returns the largest possible collection: the batch, the candidates and the free docks each bound it."""
    if batch < 1:
        raise ValueError(f"batch must be 1 or more, not {batch}")
    return min(batch, len(situation.candidates), len(situation.free_docks))


def collect_in_order(chosen: Iterable[Candidate], situation: Situation) -> Solution:
    """Plans to collect `chosen` in their order and to fill the free docks in theirs."""
    pairs = zip(chosen, situation.free_docks, strict=False)
    return Solution(tuple(Step(StepKind.COLLECT, agent.agent_id, dock_index) for agent, dock_index in pairs))


def nearest_first(place_m: tuple[float, float], points_m: Mapping[int, tuple[float, float]]) -> Iterator[int]:
    """Yields the agent whose point is nearest to `place_m` (Euclidean), then the nearest to that point, and so on.

    Of equally near agents the lowest id comes first.
    """
    left = dict(points_m)
    while left:
        agent_id = min(left, key=lambda it: (dist(place_m, left[it]), it))
        place_m = left.pop(agent_id)
        yield agent_id
