"""The tour on which some are released and others collected: every dock, every aMussel and every place once."""

from __future__ import annotations

from math import dist

import pytest
from hypothesis import given
from hypothesis import strategies as st

from apad_bridge.mission.policy.home_places import with_exchanged_homes
from apad_bridge.planning.candidates import Candidate, Situation
from apad_bridge.planning.dispatch_rule import ServiceRules
from apad_bridge.planning.exchange_of_places import (
    exchanges,
    is_worth_it,
    nearest_places,
    tour,
)
from apad_bridge.planning.solution import Solution, Step, StepKind
from apad_bridge.planning.strategies.paper_strategies import Cautious

COLLECT, DEPLOY = StepKind.COLLECT, StepKind.DEPLOY


def low(agent_id: int) -> Candidate:
    return Candidate(agent_id, agent_id, 0.0, agent_id / 100, 1.0, agent_id, 0.0)


def docked(agent_id: int, dock_index: int) -> Candidate:
    return Candidate(agent_id, 0.0, 0.0, 1.0, 1.0, -agent_id, 0.0, dock_index)


@st.composite
def situations(draw: st.DrawFn) -> Situation:
    """Up to four docks: some of their aMussels leave, some stay, and some docks are free."""
    fates = draw(st.lists(st.sampled_from(("leaves", "stays", "free")), max_size=4))
    held = {index: docked(100 + index, index) for index, fate in enumerate(fates) if fate != "free"}
    leaving = draw(st.permutations([it for index, it in held.items() if fates[index] == "leaves"]))
    others = tuple(it for index, it in held.items() if fates[index] == "stays")
    free = tuple(index for index, fate in enumerate(fates) if fate != "stays")
    pool = tuple(low(agent_id) for agent_id in range(1, draw(st.integers(1, 7))))
    return Situation(0.0, 0.0, pool, free, others, None, tuple(leaving))


@given(situations())
def test_no_dock_holds_two_and_nobody_is_forgotten(situation: Situation) -> None:
    collection = Cautious().plan(situation, 4)
    held = {it.dock_index: it.agent_id for it in (*situation.others, *situation.leaving)}
    steps = tour(collection, situation).steps
    for step in steps:
        if step.kind is COLLECT:
            assert step.dock_index not in held
            held[step.dock_index] = step.agent_id
        else:
            assert held.pop(step.dock_index) == step.agent_id
    assert [it.agent_id for it in steps if it.kind is COLLECT] == [it.agent_id for it in collection.steps]
    assert [it.agent_id for it in steps if it.kind is DEPLOY] == [it.agent_id for it in situation.leaving]


@pytest.mark.parametrize(
    ("free", "leaving", "collection", "steps", "pairs"),
    [
        pytest.param(
            (0, 1, 3),
            (docked(11, 1), docked(10, 0)),
            [Step(COLLECT, 1, 0), Step(COLLECT, 2, 1)],
            [Step(COLLECT, 1, 3), Step(DEPLOY, 11, 1), Step(COLLECT, 2, 1), Step(DEPLOY, 10, 0)],
            [(11, 1), (10, 2)],
            id="a free dock takes the collected one before the release",
        ),
        pytest.param(
            (0, 1),
            (docked(11, 1), docked(10, 0)),
            [Step(COLLECT, 1, 0)],
            [Step(DEPLOY, 11, 1), Step(COLLECT, 1, 1), Step(DEPLOY, 10, 0)],
            [(11, 1)],
            id="without a free dock the release comes first and who finds no place leaves last",
        ),
        pytest.param(
            (2, 0),
            (),
            [Step(COLLECT, 2, 2), Step(COLLECT, 1, 0)],
            [Step(COLLECT, 2, 2), Step(COLLECT, 1, 0)],
            [],
            id="a collection on which nobody leaves is flown as it was planned",
        ),
    ],
)
def test_a_tour(
    free: tuple[int, ...],
    leaving: tuple[Candidate, ...],
    collection: list[Step],
    steps: list[Step],
    pairs: list[tuple[int, int]],
) -> None:
    pool = tuple(low(it.agent_id) for it in collection)
    situation, planned = Situation(0, 0, pool, free, (), None, leaving), Solution(tuple(collection))
    assert tour(planned, situation).steps == tuple(steps) and exchanges(planned, situation) == pairs


@pytest.mark.parametrize(
    ("charge", "waiting", "lead", "makes", "is_worth"),
    [
        pytest.param(0.81, 0.9, None, True, False, id="above the limit, for whoever waits"),
        pytest.param(0.8, 0.1, None, False, False, id="at the limit"),
        pytest.param(0.5, 0.25, 0.25, True, True, id="by its lead, which just suffices"),
        pytest.param(0.5, 0.375, 0.25, False, False, id="with too small a lead"),
        pytest.param(0.5, 0.75, 0.25, False, False, id="one that waits has more"),
    ],
)
def test_one_makes_room_above_the_limit_or_by_its_lead(
    charge: float, waiting: float, lead: float | None, makes: bool, is_worth: bool
) -> None:
    rules = ServiceRules(pool_threshold=0.5, batch=1, full_threshold=0.8, charge_lead=lead)
    assert rules.leaves_for(charge, waiting) is makes
    assert is_worth_it(charge, waiting, rules) is is_worth


@given(
    st.dictionaries(st.integers(1, 9), st.tuples(st.floats(-9, 9), st.floats(-9, 9))),
    st.lists(st.tuples(st.integers(1, 9), st.integers(1, 9)), max_size=6),
)
def test_every_place_stays_somebody_s(
    places: dict[int, tuple[float, float]], pairs: list[tuple[int, int]]
) -> None:
    homes = tuple((agent_id, *place) for agent_id, place in sorted(places.items()))
    exchanged = with_exchanged_homes(homes, pairs)
    assert [it[0] for it in exchanged] == [it[0] for it in homes]
    assert sorted(it[1:] for it in exchanged) == sorted(it[1:] for it in homes)


PLACES = st.dictionaries(
    st.integers(1, 6), st.tuples(st.integers(-9, 9), st.integers(-9, 9)), min_size=1, max_size=6
)


@given(PLACES, st.data())
def test_those_that_leave_get_the_nearest_places_and_nobody_loses_one(
    places: dict[int, tuple[int, int]], data: st.DataObject
) -> None:
    leaving = data.draw(st.lists(st.sampled_from(sorted(places)), unique=True))
    pairs = nearest_places(leaving, places, (0.0, 0.0))
    homes = tuple((agent_id, *place) for agent_id, place in sorted(places.items()))
    taken = {it[0]: it[1:] for it in with_exchanged_homes(homes, pairs)}
    assert sorted(taken.values()) == sorted(places.values())
    # By the definition: each stop is the nearest of all that the stops before it have left.
    left, place_m, stops = list(places.values()), (0, 0), []
    for _ in leaving:
        place_m = min(left, key=lambda it: (dist(place_m, it), [k for k in places if places[k] == it]))
        left.remove(place_m)
        stops.append(place_m)
    assert sorted(taken[it] for it in leaving) == sorted(stops)


def test_whoever_has_one_of_the_nearest_places_keeps_it() -> None:
    homes = {1: (9.0, 0.0), 2: (1.0, 0.0), 3: (2.0, 0.0)}
    assert nearest_places([1, 2], homes, (0.0, 0.0)) == [(1, 3)]
    assert nearest_places([7], homes, (0.0, 0.0)) == []  # it has no place to give
