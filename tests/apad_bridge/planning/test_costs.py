"""Costs against sums done by hand on 3-4-5 triangles."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from apad_bridge.planning.candidates import Candidate, Situation
from apad_bridge.planning.costs import CostScales, cost_of
from apad_bridge.planning.solution import Solution, Step, StepKind
from apad_bridge.planning.strategies.by_route import BestOfPool, Blend, Exact
from apad_bridge.planning.strategies.paper_strategies import Greedy
from apad_bridge.planning.strategy import CollectionStrategy
from apad_bridge.scenario.blocks.mission_options import Costs

# The aPad at (1, 1); agent 1 lies 5 m away, agent 2 another 13 m (5-12-13) from there. Homes lie elsewhere.
SITUATION = Situation(
    1.0,
    1.0,
    (Candidate(1, 4.0, 5.0, 0.25, 1.0, 1.0, 2.0), Candidate(2, 9.0, 17.0, 0.5, 1.0, 7.0, 10.0)),
    (0, 1),
)
COLLECTION = Solution((Step(StepKind.COLLECT, 1, 0), Step(StepKind.COLLECT, 2, 1)))


class Southerly:
    """A metre to the north takes a third of a calm one's energy, and one to the south three times as much."""

    def metres(self, from_m: tuple[float, float], to_m: tuple[float, float]) -> float:
        return math.dist(from_m, to_m) * (3.0 if to_m[0] < from_m[0] else 1 / 3)

    def seconds(self, from_m: tuple[float, float], to_m: tuple[float, float]) -> float:
        return math.dist(from_m, to_m)


REDEPLOYMENT = Solution((Step(StepKind.DEPLOY, 1, 0), Step(StepKind.DEPLOY, 2, 1)))
IN_A_SEA = replace(SITUATION, sea=Southerly())


@pytest.mark.parametrize(
    ("plan", "situation", "scales", "expected"),
    [
        pytest.param(COLLECTION, SITUATION, CostScales(), (18.0, 1.25, 18.0, 1.25), id="way and demand"),
        pytest.param(COLLECTION, SITUATION, CostScales(0.5, 8.0), (18.0, 1.25, 9.0, 10.0), id="weighed"),
        pytest.param(
            COLLECTION,
            SITUATION,
            Costs(distance_per_m=2.0, energy_per_charge=0.0),
            (18.0, 1.25, 36.0, 0.0),
            id="a scenario's factors",
        ),
        # 1 m, then 6-8-10.
        pytest.param(
            REDEPLOYMENT, SITUATION, CostScales(), (11.0, 0.0, 11.0, 0.0), id="to homes, without demand"
        ),
        pytest.param(COLLECTION, IN_A_SEA, CostScales(2.0), (18.0, 1.25, 12.0, 1.25), id="by the sea"),
        pytest.param(Solution(()), SITUATION, CostScales(), (0.0, 0.0, 0.0, 0.0), id="waiting costs nothing"),
    ],
)
def test_a_plan_costs_its_way_and_its_demand(
    plan: Solution, situation: Situation, scales: CostScales, expected: tuple[float, ...]
) -> None:
    cost = cost_of(plan, situation, scales)
    found = (cost.distance_m, cost.demand, cost.distance_cost, cost.energy_cost)
    assert found == pytest.approx(expected) and cost.total == pytest.approx(sum(expected[2:]))


@pytest.mark.parametrize("strategy", [Blend(CostScales(1.0, 1.0)), Exact(CostScales()), BestOfPool()])
def test_a_planner_goes_with_the_sea_to_one_of_two_alike(strategy: CollectionStrategy) -> None:
    """The one against the sea lies nearer: 8 m at three times the price, or 12 m at a third."""
    pool = (Candidate(1, -8.0, 0.0, 0.5, 1.0, 0.0, 0.0), Candidate(2, 12.0, 0.0, 0.5, 1.0, 0.0, 0.0))
    calm = Situation(0.0, 0.0, pool, (0, 1))
    in_a_sea = replace(calm, sea=Southerly())
    # Both: with the sea first, 12 / 3 + 20 x 3, or against it, 8 x 3 + 20 / 3.
    for situation, count, chosen in ((calm, 1, [1]), (in_a_sea, 1, [2]), (in_a_sea, 2, [1, 2])):
        assert [it.agent_id for it in strategy.plan(situation, count).steps] == chosen
    assert Greedy().plan(in_a_sea, 1) == Greedy().plan(calm, 1)


def test_a_plan_for_somebody_else_is_our_bug() -> None:
    with pytest.raises(KeyError):
        cost_of(Solution((Step(StepKind.COLLECT, 3, 0),)), SITUATION)
