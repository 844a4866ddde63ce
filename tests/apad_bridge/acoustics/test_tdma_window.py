"""Tests the aPad's TDMA window by hand, and against a search through every millisecond."""

from itertools import pairwise

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from apad_bridge.acoustics.schedule import ALWAYS, TdmaWindow

FRAME = TdmaWindow(300_000, 60_000)


@pytest.mark.parametrize(
    ("window", "now_ms", "lasting_ms", "first_ms"),
    [
        (FRAME, 0, 500, 60_000),
        (FRAME, 59_999, 500, 60_000),
        (FRAME, 60_001, 500, 60_001),
        (FRAME, 299_500, 500, 299_500),
        (FRAME, 299_501, 500, 360_000),
        (FRAME, 310_000, 500, 360_000),
        # Where there is no choice it is now, or as soon as the timeslots are over.
        (TdmaWindow(300_000, 300_000), 7, 500, 7),
        (ALWAYS, 7, 500, 7),
        (FRAME, 7, 999_999, 60_000),
    ],
)
def test_by_hand(window: TdmaWindow, now_ms: int, lasting_ms: int, first_ms: int) -> None:
    assert window.first_ms(now_ms, lasting_ms) == first_ms


@given(st.integers(1, 59), st.integers(1, 60), st.integers(0, 58), st.integers(0, 500))
def test_it_is_the_first_such_time(taken_ms: int, lasting_ms: int, left_ms: int, now_ms: int) -> None:
    frame_ms = taken_ms + lasting_ms + left_ms
    found = TdmaWindow(frame_ms, taken_ms).first_ms(now_ms, lasting_ms)
    tries = range(now_ms, now_ms + 2 * frame_ms + 1)
    assert found == next(
        at for at in tries if all((at + n) % frame_ms >= taken_ms for n in range(lasting_ms))
    )


@given(
    st.integers(2, 5),
    st.integers(1, 300_000),
    st.integers(1, 290_000),
    st.integers(0, 2**40),
    st.integers(1, 2**40),
)
def test_the_turns_of_several_apads_never_meet(
    count: int, frame_ms: int, taken_ms: int, now_ms: int, later_ms: int
) -> None:
    """What fits into a turn lies in one frame's turn, outside the timeslots and outside everybody else's turn."""
    taken_ms = min(taken_ms, frame_ms - 1)
    lasting_ms = (frame_ms - taken_ms) // count
    assume(lasting_ms > 0)
    spans = []
    for which in range(1, count + 1):
        begins_ms = TdmaWindow(frame_ms, taken_ms, (which, count)).first_ms(
            now_ms + which * later_ms, lasting_ms
        )
        assert begins_ms >= now_ms + which * later_ms
        spans.append((begins_ms % frame_ms, begins_ms % frame_ms + lasting_ms))
    assert spans[0][0] >= taken_ms and spans[-1][1] <= frame_ms
    assert all(ends_ms <= begins_ms for (_, ends_ms), (begins_ms, _) in pairwise(spans))
