"""The rule of a clock that waits for those who follow it: how far it goes ahead, and how long it waits."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from unittest.mock import ANY

import pytest
from hypothesis import given
from hypothesis import strategies as st

from apad_bridge.ros.system.paced_clock import LEAD_MS, PATIENCE_S, PacedClock
from apad_bridge.ros.system.ros_pace import STANDSTILL_S, TAKEN_S

START_MS = 1_800_000_000_000
PERIOD_S = 0.02


def lasting(clock: PacedClock, wall_s: float) -> list[str]:
    """Lets wall time pass in the clock node's steps; whom the clock left out."""
    return [name for _ in range(round(wall_s / PERIOD_S)) for name in clock.advance(PERIOD_S)]


def passed_s(clock: PacedClock) -> float:
    return (clock.now_ms - START_MS) / 1000


def hear(clock: PacedClock, name: str, reached_s: float) -> bool:
    return clock.hear(name, START_MS + round(1000 * reached_s))


def hears(name: str, reached_s: float) -> Act:
    """Somebody says how far he has come; True where the clock has him back."""
    return lambda it: it.hear(name, START_MS + round(1000 * reached_s)) or None


def lasts(wall_s: float) -> Act:
    """Whom the clock leaves out in this wall time."""
    return lambda it: lasting(it, wall_s) or None


def about(seconds: float) -> object:
    return pytest.approx(seconds, abs=0.01)


HELD = [(hears("node", 1), None, 0.0), (lasts(PATIENCE_S), None, 2.0)]
Act = Callable[[PacedClock], object]
SCENES: dict[str, tuple[float, list[tuple[Act, object, object]]]] = {
    # What happens, what comes of it, and the mission seconds that have passed.
    "alone it runs at its speed": (20, [(lasts(10), None, about(200))]),
    # It does not make up for the two seconds.
    "it waits for the slowest and then goes on at its speed": (
        20,
        [
            (hears("node", 50), None, 0.0),
            (hears("supervisor", 3), None, 0.0),
            (lasts(2), None, 4.0),
            (hears("supervisor", 30), None, 4.0),
            (lasts(0.5), None, about(14)),
        ],
    ),
    # Its word of the same time is no progress.
    "one that comes no further is left out once": (
        10,
        [*HELD, (hears("node", 1), None, 2.0), (lasts(PATIENCE_S), ["node"], ANY), (lasts(60), None, ANY)],
    ),
    # One that stands still holds the clock, and so the others cannot come any further either.
    "patience counts only while it holds the clock": (
        10,
        [
            (hears("stopped", 2), None, 0.0),
            (hears("alive", 2.5), None, 0.0),
            (lasts(2 * PATIENCE_S - 1), ["stopped"], ANY),
            (hears("alive", 3.5), None, ANY),
        ],
    ),
    "one that has ended holds nobody, and its successor is another": (
        10,
        [
            (hears("supervisor", 2), None, 0.0),
            (lasts(1), None, 3.0),
            (lambda it: it.keep(["node"]), None, 3.0),
            (lasts(1), None, about(13)),
            (hears("supervisor", 12.5), None, about(13)),
            (lasts(1), None, 13.5),
        ],
    ),
    "a time of another clock is nobody's": (
        10,
        [(hears("left from an earlier clock", -5), None, 0.0), (lasts(1), None, about(10))],
    ),
}


@pytest.mark.parametrize(("speed", "steps"), SCENES.values(), ids=SCENES)
def test_how_far_it_goes(speed: float, steps: list[tuple[Act, object, object]]) -> None:
    clock = PacedClock(START_MS, speed)
    assert [(act(clock), passed_s(clock)) for act, _, _ in steps] == [
        (told, passed) for _, told, passed in steps
    ]


def test_one_that_was_left_out_holds_the_clock_again_from_where_it_has_caught_up() -> None:
    clock = PacedClock(START_MS, 10)
    hear(clock, "node", 1)
    assert lasting(clock, 2 * PATIENCE_S + 60) == ["node"] and passed_s(clock) > 600
    far_s = passed_s(clock)
    assert not hear(clock, "node", 1) and hear(clock, "node", 100)
    assert lasting(clock, 1) == [] and passed_s(clock) == far_s  # until it has caught up
    assert not hear(clock, "node", far_s)
    lasting(clock, 1)
    assert passed_s(clock) == pytest.approx(far_s + LEAD_MS / 1000)


def test_a_clock_that_had_no_processor_does_not_blame_its_followers_nor_jump() -> None:
    clock = PacedClock(START_MS, 10)
    hear(clock, "node", 0)
    assert clock.advance(3600.0) == [] and passed_s(clock) <= 1
    assert clock.advance(3600.0) == []


def test_who_waits_for_what() -> None:
    """A supervisor outlasts the clock's patience with another, and comes further before the clock loses it with itself."""
    assert TAKEN_S < PATIENCE_S < STANDSTILL_S


HAPPENINGS = st.lists(
    st.tuples(st.sampled_from("abc"), st.integers(0, 4_000), st.floats(0, 0.3)), min_size=1, max_size=60
)


@given(HAPPENINGS, st.floats(0.5, 50))
def test_it_never_moves_further_ahead_than_its_lead(
    happenings: Iterable[tuple[str, int, float]], speed: float
) -> None:
    clock, heard_ms = PacedClock(START_MS, speed), dict[str, int]()
    for name, further_ms, wall_s in happenings:
        heard_ms[name] = heard_ms.get(name, START_MS) + further_ms
        clock.hear(name, heard_ms[name])
        before_ms = clock.now_ms
        for it in clock.advance(wall_s):
            del heard_ms[it]
        assert clock.now_ms >= before_ms
        assert clock.now_ms <= max([before_ms, *heard_ms.values()]) + LEAD_MS
        if clock.now_ms > before_ms and heard_ms:
            assert clock.now_ms <= min(heard_ms.values()) + LEAD_MS
        assert clock.now_ms <= before_ms + 1 + 1000 * speed * wall_s


@given(HAPPENINGS, st.floats(0.5, 50), st.floats(1, 100))
def test_whatever_they_did_it_reaches_any_time_when_they_fall_silent(
    happenings: Iterable[tuple[str, int, float]], speed: float, mission_s: float
) -> None:
    clock, heard_ms = PacedClock(START_MS, speed), START_MS
    for name, further_ms, wall_s in happenings:
        heard_ms += further_ms
        clock.hear(name, heard_ms)
        clock.advance(wall_s)
    until_ms = clock.now_ms + 1000 * mission_s
    # Three followers can hold it one after another.
    lasting(clock, mission_s / speed + 3 * (PATIENCE_S + PERIOD_S) + 1)
    assert clock.now_ms >= until_ms
