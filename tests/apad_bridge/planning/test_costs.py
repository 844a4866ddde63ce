"""Costs against sums done by hand on 3-4-5 triangles."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from apad_bridge.planning.candidates import Candidate, Situation
from apad_bridge.planning.costs import CostBreakdown, CostScales, cost_of
from apad_bridge.planning.solution import Solution, Step, StepKind
from apad_bridge.planning.strategies.by_route import BestOfPool, Blend, Exact
from apad_bridge.planning.strategies.paper_strategies import Greedy
from apad_bridge.planning.strategy import CollectionStrategy
from apad_bridge.scenario.schema import Costs

# The aPad at (1, 1); agent 1 lies 5 m away, agent 2 another 13 m (5-12-13) from there. Homes lie elsewhere.
SITUATION = Situation(
    1.0,
    1.0,
    (Candidate(1, 4.0, 5.0, 0.25, 1.0, 1.0, 2.0), Candidate(2, 9.0, 17.0, 0.5, 1.0, 7.0, 10.0)),
    (0, 1),
)
COLLECTION = Solution((Step(StepKind.COLLECT, 1, 0), Step(StepKind.COLLECT, 2, 1)))


def test_a_collection_costs_its_way_and_its_demand() -> None:
    assert cost_of(COLLECTION, SITUATION) == CostBreakdown(18.0, 1.25, 18.0, 1.25)


def test_scale_factors_weigh_the_two_against_each_other() -> None:
    cost = cost_of(COLLECTION, SITUATION, CostScales(distance_per_m=0.5, energy_per_charge=8.0))
    assert (cost.distance_cost, cost.energy_cost, cost.total) == (9.0, 10.0, 19.0)
    assert (cost.distance_m, cost.demand) == (18.0, 1.25)


def test_a_redeployment_goes_to_homes_and_demands_no_charge() -> None:
    plan = Solution((Step(StepKind.DEPLOY, 1, 0), Step(StepKind.DEPLOY, 2, 1)))
    assert cost_of(plan, SITUATION) == CostBreakdown(11.0, 0.0, 11.0, 0.0)  # 1 m, then 6-8-10


class Southerly:
    """A metre to the north takes a third of a calm one's energy, and one to the south three times as much."""

    def metres(self, from_m: tuple[float, float], to_m: tuple[float, float]) -> float:
        return math.dist(from_m, to_m) * (3.0 if to_m[0] < from_m[0] else 1 / 3)

    def seconds(self, from_m: tuple[float, float], to_m: tuple[float, float]) -> float:
        return math.dist(from_m, to_m)


def test_a_way_costs_by_the_sea_and_is_as_long_as_before() -> None:
    cost = cost_of(COLLECTION, replace(SITUATION, sea=Southerly()), CostScales(distance_per_m=2.0))
    assert (cost.distance_m, cost.distance_cost) == (18.0, pytest.approx(2 * 18 / 3))


@pytest.mark.parametrize("strategy", [Blend(CostScales(1.0, 1.0)), Exact(CostScales()), BestOfPool()])
def test_a_planner_goes_with_the_sea_to_one_of_two_alike(strategy: CollectionStrategy) -> None:
    """The one against the sea lies nearer: 8 m at three times the price, or 12 m at a third."""
    pool = (Candidate(1, -8.0, 0.0, 0.5, 1.0, 0.0, 0.0), Candidate(2, 12.0, 0.0, 0.5, 1.0, 0.0, 0.0))
    calm = Situation(0.0, 0.0, pool, (0, 1))
    in_a_sea = replace(calm, sea=Southerly())
    assert [it.agent_id for it in strategy.plan(calm, 1).steps] == [1]
    assert [it.agent_id for it in strategy.plan(in_a_sea, 1).steps] == [2]
    # Both: with the sea first, 12 / 3 + 20 x 3, or against it, 8 x 3 + 20 / 3.
    assert [it.agent_id for it in strategy.plan(in_a_sea, 2).steps] == [1, 2]
    assert Greedy().plan(in_a_sea, 1) == Greedy().plan(calm, 1)


def test_the_scenarios_own_block_of_factors_fits() -> None:
    cost = cost_of(COLLECTION, SITUATION, Costs(distance_per_m=2.0, energy_per_charge=0.0))
    assert (cost.distance_cost, cost.energy_cost) == (36.0, 0.0)


def test_waiting_costs_nothing() -> None:
    assert cost_of(Solution(()), SITUATION).total == 0.0


def test_a_plan_for_somebody_else_is_our_bug() -> None:
    with pytest.raises(KeyError):
        cost_of(Solution((Step(StepKind.COLLECT, 3, 0),)), SITUATION)
