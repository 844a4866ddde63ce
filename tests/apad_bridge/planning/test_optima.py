"""Every strategy against the exact optimum of small pools, and what makes each what it is."""

from __future__ import annotations

from itertools import permutations
from math import dist

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scenario_files import POOL_FILE

from apad_bridge.assembly.scenario_energy_model import energy_model
from apad_bridge.planning import registry
from apad_bridge.planning.candidates import Candidate, Situation
from apad_bridge.planning.costs import CostScales, charging_demand, distance_m
from apad_bridge.planning.routes import MOST_AT_ONCE, cheapest_choice
from apad_bridge.planning.solution import Solution, StepKind, check_solution
from apad_bridge.planning.strategies.by_route import BestOfPool, Blend, Exact, ShortestOrder
from apad_bridge.planning.strategies.on_demand import EarliestDeadline, NearestJobNext
from apad_bridge.planning.strategies.paper_strategies import Cautious, Greedy
from apad_bridge.scenario.loader import load

MODEL = energy_model(load(POOL_FILE))
COLLECTIONS = [name for name in registry.known_names() if name != "greedy-redeploy"]
metres, fractions = st.floats(-60, 60), st.floats(0, 1)


@st.composite
def pools(draw: st.DrawFn, most: int = 6) -> Situation:
    ids = draw(st.lists(st.integers(1, 99), unique=True, max_size=most))
    agents = tuple(
        Candidate(k, north, east, draw(fractions), draw(fractions), north, east)
        for k in ids
        for north, east in [(draw(metres), draw(metres))]
    )
    free = draw(st.lists(st.integers(0, 5), unique=True))
    return Situation(draw(metres), draw(metres), agents, tuple(free), (), MODEL)


scales = st.builds(CostScales, st.floats(0, 3), st.floats(0, 200))


def cost(solution: Solution, situation: Situation, by: CostScales) -> float:
    """What the blend minimises."""
    way_m, lacking = distance_m(solution, situation), charging_demand(solution, situation)
    return by.distance_per_m * way_m - by.energy_per_charge * lacking


@settings(deadline=None)
@given(pools(), st.integers(1, 6), scales, st.sampled_from(COLLECTIONS))
def test_no_strategy_is_cheaper_than_the_exact_optimum(
    situation: Situation, batch: int, by: CostScales, name: str
) -> None:
    optimum = Exact(by).plan(situation, batch)
    plan = registry.collection(name, by).plan(situation, batch)
    for solution in (optimum, plan):
        check_solution(solution, situation, StepKind.COLLECT)
    if len(plan.steps) == len(optimum.steps):  # `none` collects nobody
        assert cost(optimum, situation, by) <= cost(plan, situation, by) + 1e-6


@given(pools(), st.integers(1, 6), scales)
def test_the_blend_reaches_the_optimum(situation: Situation, batch: int, by: CostScales) -> None:
    plan, optimum = Blend(by).plan(situation, batch), Exact(by).plan(situation, batch)
    assert cost(plan, situation, by) == pytest.approx(cost(optimum, situation, by), abs=1e-6)


@given(pools(), st.integers(1, 6))
def test_the_best_of_the_pool_is_the_shortest_route_and_the_shortest_order_that_of_cautious_s_set(
    situation: Situation, batch: int
) -> None:
    best, ordered = BestOfPool().plan(situation, batch), ShortestOrder().plan(situation, batch)
    cautious = Cautious().plan(situation, batch)
    assert distance_m(best, situation) <= distance_m(Greedy().plan(situation, batch), situation) + 1e-6
    assert {step.agent_id for step in ordered.steps} == {step.agent_id for step in cautious.steps}
    agents = {agent.agent_id: agent for agent in situation.candidates}
    chosen = [agents[step.agent_id].place_m for step in cautious.steps]
    shortest_m = min(
        sum(dist(a, b) for a, b in zip([situation.apad_m, *order], order, strict=False))
        for order in permutations(chosen)
    )
    assert distance_m(ordered, situation) == pytest.approx(shortest_m, abs=1e-6)


@given(pools(most=30), st.integers(1, 6))
def test_depletion_alone_is_cautious(situation: Situation, batch: int) -> None:
    plan = Blend(CostScales(distance_per_m=0.0, energy_per_charge=1.0)).plan(situation, batch)
    cautious = Cautious().plan(situation, batch)
    assert charging_demand(plan, situation) == pytest.approx(charging_demand(cautious, situation), abs=1e-6)


def test_a_deadline_is_that_of_both_batteries() -> None:
    """The first has less in its primary, and the second loses both sooner."""
    first, second = Candidate(1, 0, 1, 0.2, 1.0, 0, 1), Candidate(2, 0, 9, 0.5, 0.4, 0, 9)
    situation = Situation(0, 0, (first, second), (0,))
    plans = [it.plan(situation, 1).steps for it in (EarliestDeadline(), Cautious())]
    assert [[step.agent_id for step in steps] for steps in plans] == [[2], [1]]


def test_the_exact_optimum_refuses_a_large_pool() -> None:
    agents = tuple(Candidate(k, k, 0, 0.5, 1.0, k, 0) for k in range(1, 8))
    with pytest.raises(ValueError, match="exact plans are for 6 aMussels, not for 7: use blend"):
        Exact(CostScales()).plan(Situation(0, 0, agents, (0, 1)), 2)


def test_more_docks_than_are_chosen_at_once_are_all_filled() -> None:
    agents = [Candidate(k, 10.0 * k, 0, 0.5, 1.0, 0, 0) for k in range(1, 17)]
    chosen = cheapest_choice((0.0, 0.0), agents, MOST_AT_ONCE + 5, 1.0, 0.0)
    assert [agent.agent_id for agent in chosen] == list(range(1, MOST_AT_ONCE + 6))


def test_nearest_job_next_plans_as_greedy_and_pre_empts() -> None:
    agents = tuple(Candidate(k, k * k, -k, 0.5, 1.0, 0, 0) for k in range(1, 6))
    situation = Situation(3, 3, agents, (2, 0))
    assert NearestJobNext().plan(situation, 2) == Greedy().plan(situation, 2)
    assert NearestJobNext.pre_empts and not Greedy.pre_empts
