"""The assignment of aMussels while aPads fail: laws, over generated groups of aPads."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from apad_bridge.events.mission_events import PRE_EMPTED
from apad_bridge.mission.stand_down_rule import Breakdown
from apad_bridge.runs.parent_protocol import APadView
from apad_bridge.runs.several.assignment import Assignment
from apad_bridge.vehicle.outcomes import PrimitiveFailed, PrimitiveSucceeded

NAMES = ("a", "b", "c", "d")
METRES = st.integers(-50, 50).map(float)
POINTS = st.tuples(METRES, METRES)
IDS = tuple(range(1, 17))
DONE, STALLED = "done", "stalled"


@st.composite
def looks(draw: st.DrawFn) -> list[tuple[frozenset[str], frozenset[int], frozenset[int]]]:
    """At each look: the aPads that are down, which only grow; the aMussels with a belief; those of them that can move."""
    down: frozenset[str] = frozenset()
    found = []
    for _ in range(draw(st.integers(1, 4))):
        down |= draw(st.frozensets(st.sampled_from(NAMES), max_size=2))
        heard = draw(st.frozensets(st.sampled_from(IDS)))
        found.append((down, heard, heard & draw(st.frozensets(st.sampled_from(IDS)))))
    return found


@given(
    st.lists(st.sampled_from(NAMES), min_size=len(IDS), max_size=len(IDS)),
    st.lists(POINTS, min_size=len(IDS), max_size=len(IDS)),
    looks(),
)
def test_everybody_is_served_once_whatever_happens(
    owners: list[str],
    places_m: list[tuple[float, float]],
    told: list[tuple[frozenset[str], frozenset[int], frozenset[int]]],
) -> None:
    at = dict(zip(IDS, places_m, strict=True))
    assignment = Assignment(
        {n: [i for i, owner in zip(IDS, owners, strict=True) if owner == n] for n in NAMES}
    )
    known_down: frozenset[str] = frozenset()
    for down, heard, movable in told:
        before = assignment.shares
        seen = [
            APadView(
                name,
                name in down,
                (0.0, 0.0),
                {agent_id: at[agent_id] for agent_id in before[name] & heard},
                before[name] & movable,
            )
            for name in NAMES
        ]
        moves = assignment.plan_moves(seen)
        for move in moves:
            assert move.agent_id in before[move.giver] & movable and move.taker not in down
            # An aMussel that a working aPad serves is moved only when another aPad fails.
            assert move.giver in down or not down <= known_down
            assignment.record_move(move)
        after = assignment.shares
        assert sorted(agent_id for ids in after.values() for agent_id in ids) == list(IDS)
        stranded = {agent_id for name in down for agent_id in before[name] & movable}
        if down != frozenset(NAMES):
            assert all(not after[name] & movable for name in down)
        else:
            assert moves == []
        if stranded:
            known_down |= down
        # A second look at the same views moves nothing.
        again = [
            APadView(
                it.name,
                it.is_down,
                it.place_m,
                {i: at[i] for i in after[it.name] & heard},
                after[it.name] & movable,
            )
            for it in seen
        ]
        assert assignment.plan_moves(again) == []


def test_shares_are_even_over_those_that_are_left_and_shift_along_the_bay() -> None:
    """Three aPads along 300 m with four each. The first fails: the second takes what lay nearest, and passes two on."""
    places_m = {n: (25.0 * n, 0.0) for n in range(12)}
    assignment = Assignment({"a": range(4), "b": range(4, 8), "c": range(8, 12)})

    def seen(name: str, *, is_down: bool = False) -> APadView:
        ids = assignment.shares[name]
        return APadView(name, is_down, (0.0, 0.0), {it: places_m[it] for it in ids}, ids)

    assert assignment.plan_moves([seen("a"), seen("b"), seen("c")]) == []
    for move in assignment.plan_moves([seen("a", is_down=True), seen("b"), seen("c")]):
        assignment.record_move(move)
    assert assignment.shares == {"a": frozenset(), "b": frozenset(range(6)), "c": frozenset(range(6, 12))}


def test_who_cannot_be_moved_yet_is_moved_later_and_by_itself() -> None:
    assignment = Assignment({"a": [1, 2], "b": [3, 4], "c": [5, 6]})
    places_m = {1: (0.0, 0.0), 2: (0.0, 50.0), 3: (0.0, 10.0), 4: (0.0, 20.0), 5: (0.0, 60.0), 6: (0.0, 70.0)}

    def moves_of(*movable: int) -> list[tuple[int, str]]:
        seen = [
            APadView(name, name == "a", (0.0, 0.0), {it: places_m[it] for it in ids}, ids & set(movable))
            for name, ids in assignment.shares.items()
        ]
        moves = assignment.plan_moves(seen)
        for move in moves:
            assignment.record_move(move)
        return [(move.agent_id, move.taker) for move in moves]

    assert moves_of() == []
    assert moves_of(1) == [(1, "b")]
    # 4 is now nearer to c's aMussels than 2 is to b's, but is not moved.
    assert moves_of(1, 2, 3, 4, 5, 6) == [(2, "c")]


def test_an_aMussel_in_two_shares_is_refused() -> None:
    with pytest.raises(ValueError, match="in two shares"):
        Assignment({"a": [1, 2], "b": [2]})


@pytest.mark.parametrize(
    ("ends", "told"),
    [
        ([DONE, STALLED, DONE, STALLED, STALLED], [None] * 4 + ["2 go-tos in a row failed: stalled"]),
        # Who makes way for another has not failed.
        ([STALLED, PRE_EMPTED, STALLED], [None, None, "2 go-tos in a row failed: stalled"]),
        # It is told again after as many.
        (
            [STALLED] * 4,
            [None, "2 go-tos in a row failed: stalled", None, "4 go-tos in a row failed: stalled"],
        ),
    ],
)
def test_a_breakdown_is_go_tos_that_fail_in_a_row(ends: list[str], told: list[str | None]) -> None:
    breakdown, found = Breakdown(2), []
    for number, end in enumerate(ends):
        breakdown.go_to_ended(
            PrimitiveSucceeded(0, number) if end == DONE else PrimitiveFailed(0, number, end)
        )
        found.append(breakdown.take())
    assert found == told and breakdown.take() is None
