"""The exact optimum for six agents and fewer, by trying every choice and every order.

Source: enumeration; a pool of six has 720 plans at most for each size of a batch. It is the yardstick of the other
strategies, and shares no code with them. The cost is that of `blend`.
"""

from __future__ import annotations

from itertools import pairwise, permutations
from math import dist, fsum

from apad_bridge.planning.candidates import Candidate, Situation
from apad_bridge.planning.costs import Scales
from apad_bridge.planning.solution import Solution, StepKind
from apad_bridge.planning.strategy import collect_in_order, docks_to_fill

MOST = 6


class Exact:
    """Raises ValueError for a pool of more than six."""

    plans = StepKind.COLLECT

    def __init__(self, scales: Scales) -> None:
        self._scales = scales

    def plan(self, situation: Situation, batch: int) -> Solution:
        agents = sorted(situation.candidates, key=lambda agent: agent.agent_id)
        if len(agents) > MOST:
            raise ValueError(f"exact plans are for {MOST} aMussels, not for {len(agents)}: use blend")
        count = docks_to_fill(situation, batch)
        best = min(permutations(agents, count), key=lambda order: round(self._cost(situation, order), 9))
        return collect_in_order(best, situation)

    def _cost(self, situation: Situation, order: tuple[Candidate, ...]) -> float:
        places = [situation.apad_m, *(agent.place_m for agent in order)]
        metres = fsum(dist(a, b) for a, b in pairwise(places))
        lacking = fsum(1.0 - agent.charge for agent in order)
        return self._scales.distance_per_m * metres - self._scales.energy_per_charge * lacking
