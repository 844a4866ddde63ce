"""The way that a mission counts: what was driven, and what of its straight legs was flown."""

import math

import pytest
from flying import journaled, play
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


class Way:
    """A book of a transcript; each answer is the way driven and the way planned, in metres. The goal lies 50 m off."""

    def __init__(self) -> None:
        self.book = book_at()
        self.go_tos: list[int] = []

    def answer(self, move: str) -> str:
        name, *words = move.split()
        numbers = [float(it) for it in words if it.lstrip("-").replace(".", "").isdigit()]
        match name:
            case "go":
                self.go_tos.append(go(self.book, (numbers[0], numbers[1]) if numbers else GOAL))
            case "at":
                self.book.moved(numbers[0], numbers[1])
            case "there" | "stalls":
                of = self.go_tos[-2 if words else -1]
                ended = PrimitiveSucceeded(0, of) if name == "there" else PrimitiveFailed(0, of, "stalled")
                self.book.note_outcome(ended)
            case "ends":
                self.book.close(MissionEnd(EndReason.OPERATOR), 0)
            case "dies":
                self.book = resumed(self.book)
            case "hold":
                self.book.order(Hold(self.book.next_id(), *self.book.here))
        leg = "" if self.book.state.leg is None else ", on a leg"
        return f"{self.book.state.cost_m:.2f}, {self.book.state.planned_m:.2f}{leg}"


STORIES = {
    "a leg counts where the aPad has been": """
        go       | 0.00, 50.00, on a leg
        at 3 0   | 3.00, 50.00, on a leg
        at 3 0.2 | 3.00, 50.00, on a leg
        at 3 4   | 7.00, 50.00, on a leg
        there    | 7.00, 50.00
        at 8 4   | 7.00, 50.00
    """,
    "an aPad that does not move costs nothing": """
        go          | 0.00, 50.00, on a leg
        at 0.1 -0.1 | 0.00, 50.00, on a leg
        at -0.1 0.1 | 0.00, 50.00, on a leg
        at 0.2 -0.2 | 0.00, 50.00, on a leg
        at 0 0      | 0.00, 50.00, on a leg
        stalls      | 0.00, 0.00
        go          | 0.00, 50.00, on a leg
        at 0.1 -0.1 | 0.00, 50.00, on a leg
        at -0.1 0.1 | 0.00, 50.00, on a leg
        at 0.2 -0.2 | 0.00, 50.00, on a leg
        at 0 0      | 0.00, 50.00, on a leg
        stalls      | 0.00, 0.00
    """,
    "a go-to that led away from its goal counts no planned way": """
        go       | 0.00, 50.00, on a leg
        at -3 -4 | 5.00, 50.00, on a leg
        stalls   | 5.00, 0.00
    """,
    "a pre-empted leg ends with the next order, and late outcomes change nothing": """
        go           | 0.00, 50.00, on a leg
        at 6 8       | 10.00, 50.00, on a leg
        go 0 0       | 10.00, 20.00, on a leg
        stalls first | 10.00, 20.00, on a leg
        at 0 0       | 20.00, 20.00, on a leg
        there        | 20.00, 20.00
    """,
    "a leg that the mission's end cuts off is planned whole": """
        go       | 0.00, 50.00, on a leg
        at 12 16 | 20.00, 50.00, on a leg
        ends     | 20.00, 50.00
    """,
    "the way without a supervisor is counted when the aPad is heard again": """
        go       | 0.00, 50.00, on a leg
        dies     | 0.00, 50.00, on a leg
        at 15 20 | 25.00, 50.00, on a leg
        hold     | 25.00, 25.00
    """,
}


@pytest.mark.parametrize("story", STORIES.values(), ids=STORIES)
def test_story(story: str) -> None:
    play(story, Way().answer)


def test_a_leg_is_told_with_its_length() -> None:
    book = book_at()
    go(book)
    assert [it for it in book.take_orders() if isinstance(it, Event)] == [LegBegan(50.0)]


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
