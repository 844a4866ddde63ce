"""The built-in strategies: the agents that each one chooses, in which order, and with which docks."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import fields
from functools import partial
from math import dist
from pathlib import Path
from random import Random
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from apad_bridge.planning.candidates import Candidate, Situation
from apad_bridge.planning.solution import Solution, StepKind, check_solution
from apad_bridge.planning.strategies.paper_strategies import Cautious, Greedy, GreedyRedeploy, NoCollection

metres = st.floats(-100, 100)


def floating(agent_id: int, north_m: float, east_m: float, charge: float = 0.5) -> Candidate:
    return Candidate(agent_id, north_m, east_m, charge, 1.0, north_m, east_m)


def docked(agent_id: int, home_north_m: float, home_east_m: float, dock_index: int) -> Candidate:
    return Candidate(agent_id, 0.0, 0.0, 1.0, 1.0, home_north_m, home_east_m, dock_index)


@st.composite
def pools(draw: st.DrawFn) -> Situation:
    ids = draw(st.lists(st.integers(1, 200), unique=True, max_size=12))
    agents = [floating(k, draw(metres), draw(metres), draw(st.floats(0, 1))) for k in ids]
    free = draw(st.lists(st.integers(0, 3), unique=True))
    return Situation(draw(metres), draw(metres), tuple(agents), tuple(free))


def ids(solution: Solution) -> list[int]:
    return [step.agent_id for step in solution.steps]


def test_the_page_for_authors_describes_what_a_strategy_finds() -> None:
    page = (Path(__file__).parents[3] / "docs" / "extending.md").read_text()
    described = set(re.findall(r"`(\w+)`", page[page.index("## Strategies") : page.index("## Codecs")]))
    found = {it.name for kind in (Candidate, Situation) for it in fields(kind)}
    assert {
        "charge",
        "secondary",
        "unserved_s",
        "is_served",
        "reported",
        "others",
        "model",
        "leaving",
    } <= described & found


@pytest.mark.parametrize(
    ("strategy", "agents", "docks", "batch", "chosen"),
    [
        pytest.param(
            Cautious(),
            [
                floating(1, 0, 1, 0.6),
                floating(2, 90, 90, 0.2),
                floating(3, 0, 2, 0.7),
                floating(4, -50, 0, 0.4),
            ],
            (3, 1, 0),
            4,
            [(2, 3), (4, 1), (1, 0)],
            id="cautious takes the lowest charges wherever they are",
        ),
        pytest.param(
            Cautious(),
            [floating(k, k, 0) for k in (9, 3, 7)],
            (0, 1, 2, 3),
            2,
            [(3, 0), (7, 1)],
            id="cautious breaks ties by the lower id",
        ),
        # From the aPad 2 is nearer than 3, but after 1 the aPad is at 10 m north, and 3 is nearer than 2.
        pytest.param(
            Greedy(),
            [floating(1, 10, 0), floating(2, -11, 0), floating(3, 22, 0)],
            (0, 1, 2, 3),
            4,
            [(1, 0), (3, 1), (2, 2)],
            id="greedy moves on to what it chose",
        ),
        pytest.param(
            Greedy(),
            [floating(8, 0, 5), floating(2, 0, -5), floating(5, 5, 0)],
            (0, 1, 2, 3),
            1,
            [(2, 0)],
            id="greedy breaks ties by the lower id",
        ),
        pytest.param(
            GreedyRedeploy(),
            [docked(1, 40, 0, 0), docked(2, -15, 0, 1), docked(3, 10, 0, 3), docked(4, 30, 0, 2)],
            (),
            None,
            [(3, 3), (4, 2), (1, 0), (2, 1)],
            id="greedy-redeploy goes to the nearest home in turn and opens the dock that holds the aMussel",
        ),
    ],
)
def test_who_is_chosen_in_which_order_and_with_which_dock(
    strategy: Any,
    agents: list[Candidate],
    docks: tuple[int, ...],
    batch: int | None,
    chosen: list[tuple[int, int]],
) -> None:
    plan = strategy.plan(Situation(0, 0, tuple(agents), docks), *([] if batch is None else [batch]))
    assert [(step.agent_id, step.dock_index) for step in plan.steps] == chosen
    assert {step.kind for step in plan.steps} == {StepKind.DEPLOY if batch is None else StepKind.COLLECT}


AFLOAT = Situation(0, 0, (floating(4, 1, 1),), (0,))


@pytest.mark.parametrize(
    ("plan", "why"),
    [
        (partial(GreedyRedeploy().plan, AFLOAT), "aMussel 4 is not docked"),
        (partial(Greedy().plan, AFLOAT, batch=0), "batch must be 1 or more, not 0"),
        (partial(Cautious().plan, AFLOAT, batch=0), "batch must be 1 or more, not 0"),
    ],
)
def test_what_is_our_bug_raises(plan: Callable[[], Solution], why: str) -> None:
    with pytest.raises(ValueError, match=why):
        plan()


@given(pools(), st.integers(1, 4))
def test_no_collection_never_collects(pool: Situation, batch: int) -> None:
    assert NoCollection().plan(pool, batch) == Solution(())


@given(pools(), st.integers(1, 4))
def test_plans_are_as_large_as_they_can_be_and_can_be_carried_out(pool: Situation, batch: int) -> None:
    for strategy in (Greedy(), Cautious()):
        plan = strategy.plan(pool, batch)
        assert len(plan.steps) == min(batch, len(pool.candidates), len(pool.free_docks))
        check_solution(plan, pool, StepKind.COLLECT)


@given(pools(), st.integers(1, 4))
def test_greedy_leaves_nobody_nearer_behind(pool: Situation, batch: int) -> None:
    places = {agent.agent_id: (agent.north_m, agent.east_m) for agent in pool.candidates}
    here = (pool.apad_north_m, pool.apad_east_m)
    for chosen in ids(Greedy().plan(pool, batch)):
        assert all(dist(here, places[chosen]) <= dist(here, other) for other in places.values())
        here = places.pop(chosen)


@given(pools(), st.integers(1, 4))
def test_cautious_order_is_sorted_and_nobody_needier_is_left(pool: Situation, batch: int) -> None:
    charges = {agent.agent_id: agent.charge for agent in pool.candidates}
    chosen = [charges.pop(k) for k in ids(Cautious().plan(pool, batch))]
    assert chosen == sorted(chosen)
    assert all(charge >= last for charge in charges.values() for last in chosen)


@given(pools(), st.integers(1, 4), st.randoms(use_true_random=False))
def test_the_order_of_the_candidates_does_not_matter(pool: Situation, batch: int, rng: Random) -> None:
    shuffled = list(pool.candidates)
    rng.shuffle(shuffled)
    other = Situation(pool.apad_north_m, pool.apad_east_m, tuple(shuffled), pool.free_docks)
    for strategy in (Greedy(), Cautious()):
        assert strategy.plan(pool, batch) == strategy.plan(other, batch)
