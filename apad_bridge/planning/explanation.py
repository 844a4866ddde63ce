"""Why a strategy made its plan: the plans that it weighed, with the parts of their costs by the strategy's own measure.

A strategy explains itself by a method `explain(situation, solution)`, which returns options, the plan itself first and its
runner-up second. A strategy without one gives no reasons.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from math import fsum

from apad_bridge.planning.candidates import Candidate, Situation
from apad_bridge.planning.solution import Solution

MOST_OPTIONS = 5
"""Options of one explanation, the plan among them."""


@dataclass(frozen=True, slots=True)
class Option:
    """A plan that was weighed: the agents in order, and the parts of its cost by name. The least cost is the best."""

    agents: tuple[int, ...]
    parts: Mapping[str, float] = field(default_factory=dict)

    @property
    def cost(self) -> float:
        """The sum of the parts."""
        return fsum(self.parts.values())


def with_exchanges(
    situation: Situation, solution: Solution, parts_of: Callable[[Sequence[Candidate]], Mapping[str, float]]
) -> list[Option]:
    """The plan, and the cheapest of the plans with one of its agents exchanged for another candidate, by cost.

    Of equally cheap ones the first by ids.
    """
    agents = {agent.agent_id: agent for agent in situation.candidates}
    plan = [agents[step.agent_id] for step in solution.steps]
    options = [_option(it, parts_of) for it in _exchanged(plan, situation.candidates)]
    return [_option(plan, parts_of), *best_of(options)]


def best_of(options: Sequence[Option]) -> list[Option]:
    """The cheapest options beside the plan itself, the runner-up first."""
    return sorted(options, key=lambda it: (it.cost, it.agents))[: MOST_OPTIONS - 1]


def _exchanged(plan: Sequence[Candidate], candidates: Sequence[Candidate]) -> Iterator[list[Candidate]]:
    for place in range(len(plan)):
        for other in candidates:
            if other not in plan:
                yield [*plan[:place], other, *plan[place + 1 :]]


def _option(
    agents: Sequence[Candidate], parts_of: Callable[[Sequence[Candidate]], Mapping[str, float]]
) -> Option:
    return Option(tuple(agent.agent_id for agent in agents), parts_of(agents))


def way_m(situation: Situation, agents: Sequence[Candidate]) -> float:
    """The metres from the aPad through the agents, in their order, as the way costs them."""
    place_m, total_m = situation.apad_m, 0.0
    for agent in agents:
        total_m += situation.metres(place_m, agent.place_m)
        place_m = agent.place_m
    return total_m


def way_s(situation: Situation, agents: Sequence[Candidate], speed_m_s: float) -> float:
    """The time of the same way; `speed_m_s` is that in calm water."""
    if situation.sea is None:
        return way_m(situation, agents) / speed_m_s
    places_m = [situation.apad_m, *(agent.place_m for agent in agents)]
    return fsum(situation.sea.seconds(one, other) for one, other in pairwise(places_m))
