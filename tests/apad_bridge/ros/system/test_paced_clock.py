"""The rule of a clock that waits for those who follow it: how far it goes ahead, and how long it waits."""

from __future__ import annotations

from collections.abc import Iterable

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


def test_alone_it_runs_at_its_speed() -> None:
    clock = PacedClock(START_MS, 20)
    assert lasting(clock, 10) == [] and passed_s(clock) == pytest.approx(200, abs=0.01)


def test_it_waits_for_the_slowest_and_then_goes_on_at_its_speed() -> None:
    clock = PacedClock(START_MS, 20)
    hear(clock, "node", 50)
    hear(clock, "supervisor", 3)
    assert lasting(clock, 2) == [] and passed_s(clock) == 4
    hear(clock, "supervisor", 30)
    lasting(clock, 0.5)
    assert passed_s(clock) == pytest.approx(14, abs=0.01)  # it does not make up for the two seconds


@pytest.fixture
def clock() -> PacedClock:
    return PacedClock(START_MS, 10)


def test_one_that_comes_no_further_is_left_out_once_until_it_does(clock: PacedClock) -> None:
    hear(clock, "node", 1)
    assert lasting(clock, PATIENCE_S) == []
    hear(clock, "node", 1)  # its word of the same time is no progress
    assert lasting(clock, PATIENCE_S) == ["node"]
    assert lasting(clock, 60) == [] and passed_s(clock) > 600
    far_s = passed_s(clock)
    assert not hear(clock, "node", 1) and hear(clock, "node", 100)
    assert lasting(clock, 1) == [] and passed_s(clock) == far_s  # until it has caught up
    assert not hear(clock, "node", far_s)
    lasting(clock, 1)
    assert passed_s(clock) == pytest.approx(far_s + LEAD_MS / 1000)


def test_patience_counts_only_while_it_holds_the_clock(clock: PacedClock) -> None:
    """One that stands still holds the clock, and so the others cannot come any further either."""
    hear(clock, "stopped", 2)
    hear(clock, "alive", 2.5)
    assert lasting(clock, 2 * PATIENCE_S - 1) == ["stopped"]
    assert hear(clock, "alive", 3.5) is False


def test_one_that_has_ended_holds_nobody_and_its_successor_is_another(clock: PacedClock) -> None:
    hear(clock, "supervisor", 2)
    lasting(clock, 1)
    clock.keep(["node"])
    lasting(clock, 1)
    assert passed_s(clock) == pytest.approx(13, abs=0.01)
    hear(clock, "supervisor", 12.5)
    lasting(clock, 1)
    assert passed_s(clock) == 13.5


def test_a_time_of_another_clock_is_nobodys(clock: PacedClock) -> None:
    hear(clock, "left from an earlier clock", -5)
    lasting(clock, 1)
    assert passed_s(clock) == pytest.approx(10, abs=0.01)


def test_a_clock_that_had_no_processor_does_not_blame_its_followers_nor_jump(clock: PacedClock) -> None:
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
