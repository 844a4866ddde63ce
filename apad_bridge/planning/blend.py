"""Blends of distance and depletion, with the scenario's scale factors, and the shortest route through any of the pool.

Source: the paper's section III, "aPad distance and energy cost calculation modules with adjustable scale factors, making it
possible to produce a variety of behaviours". The plan is the cheapest of all choices and orders, where

    cost = distance_per_m x (metres of the route) - energy_per_charge x (sum of the lacking charges),

with the factors of the scenario's `mission.costs`: at energy_per_charge 0 it is the shortest route through any four of the
pool; at distance_per_m 0, the aMussels of Cautious.
"""

from __future__ import annotations

from math import fsum

from apad_bridge.planning.candidates import Situation
from apad_bridge.planning.costs import CostScales, Scales
from apad_bridge.planning.explanation import Option, way_m, with_exchanges
from apad_bridge.planning.routes import cheapest_choice
from apad_bridge.planning.solution import Solution, StepKind
from apad_bridge.planning.strategy import collect_in_order, docks_to_fill


class Blend:
    """Chooses and orders by the blended cost; of equally cheap plans the first by ids."""

    plans = StepKind.COLLECT

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
