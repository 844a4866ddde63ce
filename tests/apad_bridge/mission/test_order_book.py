"""The way that a mission counts: what was driven, and what of its straight legs was flown."""

import math

import pytest
from flying import journaled
from hypothesis import given
from hypothesis import strategies as st

from apad_bridge.events.event import Event
from apad_bridge.events.mission_events import LegBegan, MissionEnd, MissionState
from apad_bridge.events.run_events import EndReason
from apad_bridge.mission.order_book import CHORD_M, OrderBook
from apad_bridge.vehicle.commands import GoTo, Hold
from apad_bridge.vehicle.outcomes import PrimitiveFailed, PrimitiveSucceeded

GOAL = (30.0, 40.0)
RADIUS_M = 0.5


def book_at(place: tuple[float, float] = (0.0, 0.0), state: MissionState | None = None) -> OrderBook:
    book = OrderBook(state or MissionState())
    book.moved(*place)
    return book


def go(book: OrderBook, goal: tuple[float, float] = GOAL) -> int:
    primitive_id = book.next_id()
    book.order(GoTo(primitive_id, *goal, 0.5, RADIUS_M))
    return primitive_id


def resumed(book: OrderBook) -> OrderBook:
    """The book of another supervisor, which begins with the newest snapshot."""
    return OrderBook(journaled(book.state))


def along(share: float) -> tuple[float, float]:
    """The point at a share of the straight way to the goal, 50 m off."""
    return (30.0 * share, 40.0 * share)


@pytest.fixture
def book() -> OrderBook:
    return book_at()


def test_a_leg_counts_where_the_aPad_has_been(book: OrderBook) -> None:
    goto = go(book)
    for place in ((3.0, 0.0), (3.0, 0.2), (3.0, 4.0)):
        book.moved(*place)
    assert (book.state.cost_m, book.state.planned_m) == (pytest.approx(7.0), 50.0)
    book.note_outcome(PrimitiveSucceeded(0, goto))
    book.moved(8.0, 4.0)
    assert (book.state.cost_m, book.state.planned_m, book.state.leg) == (pytest.approx(7.0), 50.0, None)
    assert [it for it in book.take_orders() if isinstance(it, Event)] == [LegBegan(50.0)]


def test_an_aPad_that_does_not_move_costs_nothing(book: OrderBook) -> None:
    for _ in range(40):
        goto = go(book)
        for scatter in (0.1, -0.1, 0.2, 0.0):
            book.moved(scatter, -scatter)
        book.note_outcome(PrimitiveFailed(0, goto, "stalled"))
    assert book.state.cost_m == book.state.planned_m == 0.0


def test_a_go_to_that_led_away_from_its_goal_counts_no_planned_way(book: OrderBook) -> None:
    goto = go(book)
    book.moved(-3.0, -4.0)
    book.note_outcome(PrimitiveFailed(0, goto, "stalled"))
    assert (book.state.cost_m, book.state.planned_m) == (pytest.approx(5.0), 0.0)


def test_a_pre_empted_leg_ends_with_the_next_order_and_late_outcomes_change_nothing(book: OrderBook) -> None:
    first = go(book)
    book.moved(*along(0.2))
    second = go(book, (0.0, 0.0))
    book.note_outcome(PrimitiveFailed(0, first, "pre-empted"))
    assert book.state.leg is not None
    book.moved(0.0, 0.0)
    book.note_outcome(PrimitiveSucceeded(0, second))
    assert (book.state.cost_m, book.state.planned_m) == (pytest.approx(20.0), pytest.approx(20.0))


def test_a_leg_that_the_missions_end_cuts_off_is_planned_whole(book: OrderBook) -> None:
    go(book)
    book.moved(*along(0.4))
    book.close(MissionEnd(EndReason.OPERATOR), 0)
    assert (book.state.cost_m, book.state.planned_m) == (pytest.approx(20.0), 50.0)


def test_the_way_without_a_supervisor_is_counted_when_the_aPad_is_heard_again(book: OrderBook) -> None:
    go(book)
    after = resumed(book)
    after.moved(*along(0.5))
    assert after.state.cost_m == pytest.approx(25.0)
    after.order(Hold(after.next_id(), *along(0.5)))
    assert (after.state.cost_m, after.state.planned_m) == (pytest.approx(25.0), pytest.approx(25.0))


shares = st.floats(0.0, 1.0 - 2 * RADIUS_M / 50.0)


@given(st.lists(st.tuples(shares, st.booleans()), max_size=8))
def test_cut_as_it_may_be_a_straight_way_is_counted_once(cuts: list[tuple[float, bool]]) -> None:
    """Failures and resumes at any places of it: driven is what was driven, planned is the leg."""
    book = book_at()
    goto = go(book)
    for share, dies in sorted(cuts):
        if dies:
            book = resumed(book)
        book.moved(*along(share))
        if not dies:
            book.note_outcome(PrimitiveFailed(0, goto, "stalled"))
        goto = go(book)
    left_m = RADIUS_M / 2
    book.moved(*along(1.0 - left_m / 50.0))
    book.note_outcome(PrimitiveSucceeded(0, goto))
    assert book.state.cost_m == pytest.approx(50.0 - left_m)
    assert book.state.planned_m == pytest.approx(50.0)


@given(st.lists(st.tuples(st.floats(-5, 5), st.floats(-5, 5)), min_size=1, max_size=20))
def test_driven_lies_between_the_straight_way_and_the_poses_path(places: list[tuple[float, float]]) -> None:
    book = book_at()
    goto = go(book)
    for place in places:
        book.moved(*place)
    book.note_outcome(PrimitiveFailed(0, goto, "stalled"))
    path = [(0.0, 0.0), *places]
    whole_m = sum(map(math.dist, path, path[1:]))
    assert math.dist(path[0], path[-1]) - 1e-9 <= book.state.cost_m <= whole_m + 1e-9
    assert whole_m - book.state.cost_m <= 2 * CHORD_M * len(places)
