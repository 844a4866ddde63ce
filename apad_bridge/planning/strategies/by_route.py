"""Strategies that choose by way and lacking charge together, and that order by the shortest route.

Source: the paper's section III, "aPad distance and energy cost calculation modules with adjustable scale factors, making it
possible to produce a variety of behaviours", and its section V-A, which calls the collection of a chosen set a problem like
the Travelling Salesman's. With the factors of the scenario's `mission.costs`, a plan's cost is

    cost = distance_per_m x (metres of the route) - energy_per_charge x (sum of the lacking charges).

At energy_per_charge 0 the cheapest plan is the shortest route through any four of the pool; at distance_per_m 0 it has the
aMussels of Cautious.
"""

from __future__ import annotations

from itertools import pairwise, permutations
from math import fsum

from apad_bridge.planning.candidates import Candidate, Situation
from apad_bridge.planning.costs import CostScales, Scales
from apad_bridge.planning.explanation import Option, way_m, with_exchanges
from apad_bridge.planning.routes import cheapest_choice
from apad_bridge.planning.solution import Solution
from apad_bridge.planning.strategies.paper_strategies import Cautious
from apad_bridge.planning.strategy import CollectionStrategy, collect_in_order, docks_to_fill

_MOST_EXACT = 6


class Blend(CollectionStrategy):
    """The cheapest of all choices and orders; of equally cheap plans the first by ids."""

    def __init__(self, scales: Scales) -> None:
        self._scales = scales

    def plan(self, situation: Situation, batch: int) -> Solution:
        count = docks_to_fill(situation, batch)
        chosen = cheapest_choice(
            situation.apad_m,
            situation.candidates,
            count,
            self._scales.distance_per_m,
            self._scales.energy_per_charge,
            situation.metres,
        )
        return collect_in_order(chosen, situation)

    def explain(self, situation: Situation, solution: Solution) -> list[Option]:
        scales = self._scales
        return with_exchanges(
            situation,
            solution,
            lambda agents: {
                "way": scales.distance_per_m * way_m(situation, agents),
                "lacking charge": -scales.energy_per_charge * fsum(1.0 - agent.charge for agent in agents),
            },
        )


class BestOfPool(Blend):
    """The shortest route through any batch of the pool: Greedy's aim, reached exactly."""

    def __init__(self) -> None:
        super().__init__(CostScales(distance_per_m=1.0, energy_per_charge=0.0))


class ShortestOrder(CollectionStrategy):
    """The agents that Cautious chooses, along the shortest route: exact for six docks and fewer (`routes.py`).

    All of a batch wait for the last one to be docked, so their order costs way alone, and not charge.
    """

    def plan(self, situation: Situation, batch: int) -> Solution:
        chosen = {step.agent_id for step in Cautious().plan(situation, batch).steps}
        agents = [agent for agent in situation.candidates if agent.agent_id in chosen]
        return collect_in_order(
            cheapest_choice(situation.apad_m, agents, len(agents), 1.0, 0.0, situation.metres), situation
        )

    def explain(self, situation: Situation, solution: Solution) -> list[Option]:
        return Cautious().explain(situation, solution)


class Exact(CollectionStrategy):
    """The exact optimum of the cost for six agents and fewer, by every choice and every order.

    Source: enumeration; a pool of six has 720 plans at most for each size of a batch. It is the yardstick of the other
    strategies, and shares no code with them. Raises ValueError for a pool of more than six.
    """

    def __init__(self, scales: Scales) -> None:
        self._scales = scales

    def plan(self, situation: Situation, batch: int) -> Solution:
        agents = sorted(situation.candidates, key=lambda agent: agent.agent_id)
        if len(agents) > _MOST_EXACT:
            raise ValueError(f"exact plans are for {_MOST_EXACT} aMussels, not for {len(agents)}: use blend")
        count = docks_to_fill(situation, batch)
        best = min(permutations(agents, count), key=lambda order: round(self._cost(situation, order), 9))
        return collect_in_order(best, situation)

    def _cost(self, situation: Situation, order: tuple[Candidate, ...]) -> float:
        places = [situation.apad_m, *(agent.place_m for agent in order)]
        metres = fsum(situation.metres(a, b) for a, b in pairwise(places))
        lacking = fsum(1.0 - agent.charge for agent in order)
        return self._scales.distance_per_m * metres - self._scales.energy_per_charge * lacking
