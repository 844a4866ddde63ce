from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import numpy as np
import pytest

from apad_bridge.beliefs.modes import Mode
from apad_bridge.beliefs.spent_charge import (
    ChargeChoice,
    Load,
    Spent,
    merged,
    propagated,
    scheduled_rows,
    spending,
    usual_rows,
)
from apad_bridge.beliefs.twin_parameters import Habits, Schedule

HOUR = 3_600_000
PER_MIN = (0.0001, 0.001, 0.003, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
HABITS = Habits(
    every_ms=HOUR,
    unscheduled=0.06,
    stays=0.5,
    shares=(0.6, 0.3, 0.1),
    daily=0.0,
    plan_lasts_ms=1,
    plan_deviation=0.0,
    seen_before=1.0,
)
ROWS = ((0.7, 0.2, 0.1), (0.5, 0.4, 0.1), (0.3, 0.1, 0.6))


def chain(_: int) -> ChargeChoice:
    return ChargeChoice(ROWS, None, 0.0)


def after(load: Load, from_ms: int, to_ms: int, choose: Callable[[int], ChargeChoice] = chain) -> Load:
    return propagated(load, from_ms, to_ms, spending(PER_MIN, None), HOUR, choose)


def by_trial(hours: int, trials: int = 200_000) -> tuple[np.ndarray, np.ndarray]:
    """Modes and amounts of a chain that begins awake at half past the hour, by Monte Carlo."""
    rng = np.random.default_rng(3)
    rates = 60 * np.array(PER_MIN[:3])
    modes = np.full(trials, Mode.IDLE)
    spent = np.full(trials, 0.5 * rates[Mode.IDLE])
    for _ in range(hours):
        luck = rng.random(trials)
        modes = (luck[:, None] > np.cumsum(np.array(ROWS)[modes], axis=1)[:, :2]).sum(axis=1)
        spent += rates[modes]
    return modes, spent


def test_moments_by_mode_are_those_of_the_chain() -> None:
    load = after(Load.known(Mode.IDLE), HOUR // 2, 9 * HOUR - 1)
    modes, spent = by_trial(8)
    for mode in (Mode.ASLEEP, Mode.IDLE, Mode.HIGH_LOAD):
        there = modes == mode
        probability, mean, variance = load.by_mode[mode]
        assert probability == pytest.approx(there.mean(), abs=0.004)
        assert mean == pytest.approx(spent[there].mean(), rel=0.01)
        assert variance == pytest.approx(spent[there].var(), rel=0.03)
    assert load.expected[:2] == (pytest.approx(0.4**8), pytest.approx(8.5 * 0.06, rel=1e-5))


def test_cuts_do_not_show() -> None:
    whole, cut = after(Load.known(Mode.ASLEEP), 0, 7 * HOUR + 5), Load.known(Mode.ASLEEP)
    for times in pairwise([0, 1, HOUR - 1, HOUR, HOUR + 1, 3 * HOUR, 7 * HOUR + 4, 7 * HOUR + 5]):
        cut = after(cut, *times)
    for one, other in zip(cut.by_mode, whole.by_mode, strict=True):
        assert one == pytest.approx(other, rel=1e-9, abs=1e-12)


def test_the_schedule_is_followed_but_for_the_unscheduled_share() -> None:
    schedule = Schedule((0, 2 * HOUR), (Mode.ASLEEP, Mode.HIGH_LOAD))

    def commanded(decision_ms: int) -> ChargeChoice:
        mode = schedule.at(decision_ms)
        return ChargeChoice(scheduled_rows(HABITS, mode), mode, 0.0)

    load = after(Load.known(Mode.ASLEEP), 0, 4 * HOUR - 1, commanded)
    expected = pytest.approx(0.94**3), pytest.approx(2 * 0.006 + 2 * 0.18, rel=1e-4)
    assert load.expected[:2] == expected
    assert [load.by_mode[it][0] for it in (Mode.HIGH_LOAD, Mode.IDLE)] == pytest.approx([0.94, 0.03])


def test_rows_without_a_schedule_add_up_and_remember() -> None:
    rows, remembering = (usual_rows(HABITS, HABITS.shares, *it) for it in ((None, 0.0), (Mode.IDLE, 0.75)))
    assert [sum(row) for row in (*rows, *remembering)] == pytest.approx([1.0] * 6)
    assert remembering[2][1] == pytest.approx(0.75 + 0.25 * 0.5 * 0.3)


def test_an_unknown_plan_makes_the_deviation_grow_with_the_time() -> None:
    unknown = ChargeChoice(((1.0, 0.0, 0.0),) * 3, None, 0.002)
    load = after(Load.known(Mode.ASLEEP), 0, 10 * HOUR, lambda _: unknown)
    assert load.total()[2] == pytest.approx((10 * 0.002) ** 2)


def test_a_shape_keeps_the_first_two_moments() -> None:
    load = Load(Load.known(Mode.ASLEEP).by_mode, Spent(0.0, 0.0, 0.0), Mode.ASLEEP, unscheduled_decisions=3)
    rest = Spent(0.4, 0.2, 0.01)
    parts = load.skewed_parts(rest)
    assert merged(parts) == pytest.approx(rest, rel=1e-4) and parts[1][1] > parts[0][1]
    assert Load.known(Mode.ASLEEP).skewed_parts(rest) == [rest]
