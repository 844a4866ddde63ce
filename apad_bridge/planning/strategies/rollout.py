"""Rollout over the energy model: judges plans by what follows from them, and takes the best one.

Source: D. P. Bertsekas, J. N. Tsitsiklis, C. Wu, "Rollout Algorithms for Combinatorial Optimization", Journal of Heuristics
3, 1997: each decision is tried, a base policy carries the mission on from there, and the decision with the best result is
taken. The result is never worse than the base policy's by the same model.

The plans that are tried are those of the base policy with several gains, and the best of them with one aMussel exchanged
for one that the base policy would take soon. That goes on as long as it helps and `MOST_PROJECTED` allows. A plan's worth,
in the unit of the scenario's `mission.costs`, is

    energy_per_charge x (batteries spent at work + SALVAGE x batteries left at the end) - distance_per_m x metres

over a horizon of three quarters of a discharge, the same at any time of a mission: the strategy does not know when it ends.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import fsum

from apad_bridge.planning.candidates import Candidate, Situation
from apad_bridge.planning.costs import Scales
from apad_bridge.planning.energy_model import EnergyModel
from apad_bridge.planning.explanation import Option, best_of
from apad_bridge.planning.projection import ProjectedOutcome, Projection
from apad_bridge.planning.routes import cheapest_choice
from apad_bridge.planning.solution import Solution
from apad_bridge.planning.strategy import CollectionStrategy, collect_in_order, docks_to_fill

SALVAGE = 0.75
"""The share of a charge left at the horizon that is spent at work later."""
HORIZON_DISCHARGES = 0.75
"""The horizon, in times that a full battery lasts."""
BASE_GAIN_M = 60.0
"""The base policy goes so far for an aMussel that lacks a whole battery."""
GAINS_M = (0.0, 30.0, 60.0, 120.0, 1e6)
"""Gains of the plans that are tried first: the nearest, blends, and those most in need."""
MOST_PROJECTED = 48
"""Plans that are projected for one decision, so that one for 120 aMussels takes a quarter of a second."""
SOON = 2
"""An exchange takes those whom the base policy would collect with a plan of so many times the length."""


class Rollout(CollectionStrategy):
    """Projects the mission behind each of many plans, and takes the plan with the most work and the least way.

    Raises ValueError for a situation without an energy model.
    """

    unfairness = 0.0
    """The worth of an aMussel's idle time falls with its square, so that nobody idles long; 0 counts idle time alike."""

    def __init__(self, scales: Scales) -> None:
        self._scales = scales
        self._weighed: tuple[Situation | None, dict[tuple[int, ...], Option]] = None, {}
        """The newest situation and what was weighed in it, for `explain`."""

    def plan(self, situation: Situation, batch: int) -> Solution:
        model, count = situation.model, docks_to_fill(situation, batch)
        if model is None:
            raise ValueError("a rollout needs the mission's energy model, which a script's plan has not")
        if not count:
            return Solution(())
        horizon_s = HORIZON_DISCHARGES / model.drain_per_s
        candidates = situation.candidates
        projection = Projection(situation, model, horizon_s, BASE_GAIN_M)
        weighed: dict[tuple[int, ...], Option] = {}

        def cost(plan: tuple[int, ...]) -> float:
            if plan not in weighed:
                ids = tuple(candidates[index].agent_id for index in plan)
                weighed[plan] = Option(ids, self.parts_of(projection.of(plan), model, horizon_s))
            return weighed[plan].cost

        longer = [_by_gain(situation, gain_m, SOON * count) for gain_m in GAINS_M]
        starts = {plan[:count] for plan in longer}
        starts |= {_shortest(situation, plan) for plan in starts}
        best = min(sorted(starts), key=cost)
        soon = list(dict.fromkeys(index for step in zip(*longer, strict=True) for index in step))
        improved = True
        while improved:
            exchanged = [
                _shortest(situation, (*best[:place], other, *best[place + 1 :]))
                for other in soon
                if other not in best
                for place in range(count)
            ]
            affordable = [
                it for it in exchanged if it in weighed or (len(weighed) < MOST_PROJECTED and cost(it))
            ]
            better = min(affordable, key=cost, default=best)
            improved = cost(better) < cost(best) - 1e-9
            best = better if improved else best
        self._weighed = situation, weighed
        return collect_in_order([candidates[index] for index in best], situation)

    def explain(self, situation: Situation, solution: Solution) -> list[Option]:
        """The plans that were weighed; it makes the plan again unless `situation` is that of the last one."""
        if self._weighed[0] is not situation:
            self.plan(situation, len(solution.steps))
        agents = tuple(step.agent_id for step in solution.steps)
        by_agents = {option.agents: option for option in self._weighed[1].values()}
        others = [option for option in by_agents.values() if option.agents != agents]
        return [by_agents[agents], *best_of(others)]

    def parts_of(self, outcome: ProjectedOutcome, model: EnergyModel, horizon_s: float) -> dict[str, float]:
        """The parts of a projected cost: what the plan is worth, negative, and what it costs."""
        per_battery, drain = self._scales.energy_per_charge, model.drain_per_s
        idle_s = fsum((horizon_s - active_s) ** 2 for active_s in outcome.active_s) / horizon_s
        return {
            "spent at work": -per_battery * drain * fsum(outcome.active_s),
            "left at the end": -per_battery * SALVAGE * fsum(outcome.charges),
            "idle": per_battery * drain * self.unfairness * idle_s,
            "way": self._scales.distance_per_m * outcome.metres,
        }


class FairRollout(Rollout):
    """A rollout that spreads idle time over the fleet: it costs with its square."""

    unfairness = 3.0


def _by_gain(situation: Situation, gain_m: float, count: int) -> tuple[int, ...]:
    """The plan of the base policy with another gain; of equal costs the first candidate."""
    candidates, place_m = situation.candidates, situation.apad_m
    plan: list[int] = []
    for _ in range(min(count, len(candidates))):
        left = [index for index in range(len(candidates)) if index not in plan]
        plan.append(
            min(
                left,
                key=lambda it: (
                    situation.metres(place_m, candidates[it].place_m) + gain_m * candidates[it].charge
                ),
            )
        )
        place_m = candidates[plan[-1]].place_m
    return tuple(plan)


def _shortest(situation: Situation, plan: Sequence[int]) -> tuple[int, ...]:
    """The same aMussels along the shortest route."""
    candidates = situation.candidates
    chosen: list[Candidate] = [candidates[index] for index in plan]
    route = cheapest_choice(situation.apad_m, chosen, len(chosen), 1.0, 0.0, situation.metres)
    return tuple(candidates.index(agent) for agent in route)
