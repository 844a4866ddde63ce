"""The cheapest choice of agents with its route, exactly.

A route begins at the aPad's place, passes each of its agents once, and does not return.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import dist, inf

from apad_bridge.planning.candidates import Candidate

_TIE = 1e-9
"""Costs that differ by less are equal: the lower ids win."""
MOST_AT_ONCE = 6
"""Agents that are chosen at once. More follow from the last one's place, so that a plan of many docks stays quick."""
Metres = Callable[[tuple[float, float], tuple[float, float]], float]


def cheapest_choice(
    place_m: tuple[float, float],
    candidates: Sequence[Candidate],
    count: int,
    per_m: float,
    per_charge: float,
    metres: Metres = dist,
) -> list[Candidate]:
    """Returns `count` candidates in the order of their route, such that route and lacking charge cost the least together.

    The cost is per_m x (metres of the route) - per_charge x (sum of the charges that they lack): a depleted agent is worth
    a longer way. Up to `MOST_AT_ONCE` it is the least of all choices and orders; of equally cheap ones the first by ids.
    `metres` measures a leg, which may cost more there than back.
    """
    chosen: list[Candidate] = []
    while len(chosen) < count:
        left = [agent for agent in candidates if agent not in chosen]
        chosen += _cheapest_at_once(
            place_m, left, min(MOST_AT_ONCE, count - len(chosen)), per_m, per_charge, metres
        )
        place_m = chosen[-1].place_m
    return chosen


def _cheapest_at_once(
    place_m: tuple[float, float],
    candidates: Sequence[Candidate],
    count: int,
    per_m: float,
    per_charge: float,
    metres: Metres,
) -> list[Candidate]:
    """Branch and bound: each agent still to be chosen costs at least the shortest leg to it, less its gain."""
    agents = sorted(candidates, key=lambda agent: agent.agent_id)
    legs = [[per_m * metres(a.place_m, b.place_m) for b in agents] for a in agents]
    first = [per_m * metres(place_m, agent.place_m) for agent in agents]
    gains = [per_charge * (1.0 - agent.charge) for agent in agents]
    nearest = [
        min((row[index] for other, row in enumerate(legs) if other != index), default=0.0)
        for index in range(len(agents))
    ]
    least = [min(nearest[index], first[index]) - gains[index] for index in range(len(agents))]
    by_least = sorted(range(len(agents)), key=least.__getitem__)
    best_cost = inf
    best: list[int] = []

    def rest_at_least(chosen: list[int], wanted: int) -> float:
        found, total = 0, 0.0
        for index in by_least:
            if found == wanted:
                break
            if index not in chosen:
                found, total = found + 1, total + least[index]
        return total

    def extend(chosen: list[int], cost: float) -> None:
        nonlocal best_cost, best
        if not (wanted := count - len(chosen)):
            if cost < best_cost - _TIE or (cost <= best_cost + _TIE and chosen < best):
                best_cost, best = min(cost, best_cost), list(chosen)
            return
        way = legs[chosen[-1]] if chosen else first
        steps = sorted(
            (way[index] - gains[index], index) for index in range(len(agents)) if index not in chosen
        )
        for step, index in steps:
            longer = [*chosen, index]
            if cost + step + rest_at_least(longer, wanted - 1) <= best_cost + _TIE:
                extend(longer, cost + step)

    extend([], 0.0)
    return [agents[index] for index in best]
