"""The MU's clock: exact readings, their inverse, alarms that ring once, and the bound of its error."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_model.clock import AlarmClock
from firmware_model.hardware.clock_chip import BILLION, Clock

DAY_MS = 86_400_000
DRIFTS = st.integers(-200_000, 200_000)
TIMES = st.integers(0, 400 * DAY_MS)


def test_twenty_parts_in_a_million_are_1728_ms_a_day() -> None:
    fast, slow = Clock(0, 0, 20_000), Clock(0, 0, -20_000)
    assert [it.reading_at(DAY_MS) - DAY_MS for it in (fast, slow)] == [1728, -1728]
    assert (fast.doubt_ms(DAY_MS, 20_000), Clock(5000, 700, 0).reading_at(6000)) == (1728, 1700)


def test_a_clock_that_is_none_is_refused() -> None:
    with pytest.raises(ValueError, match="no clock"):
        Clock(0, 0, BILLION)
    with pytest.raises(ValueError, match="time went back"):
        Clock(10, 0, 0).reading_at(9)


@given(TIMES, TIMES, DRIFTS, st.integers(0, 2 * DAY_MS))
def test_when_is_the_first_time_of_a_reading(
    anchor_ms: int, reading_ms: int, drift_ppb: int, ahead_ms: int
) -> None:
    clock = Clock(anchor_ms, reading_ms, drift_ppb)
    at_ms = clock.when(reading_ms + ahead_ms)
    assert clock.reading_at(at_ms) >= reading_ms + ahead_ms
    assert at_ms == anchor_ms or clock.reading_at(at_ms - 1) < reading_ms + ahead_ms


@given(TIMES, DRIFTS, st.integers(0, 400 * DAY_MS), st.integers(0, 100_000))
def test_one_that_was_right_and_drifts_within_its_bound_is_never_off_by_more_than_the_doubt(
    anchor_ms: int, drift_ppb: int, elapsed_ms: int, spare_ppb: int
) -> None:
    now_ms = anchor_ms + elapsed_ms
    off_ms = Clock(anchor_ms, anchor_ms, drift_ppb).reading_at(now_ms) - now_ms
    assert abs(off_ms) <= Clock(anchor_ms, anchor_ms, drift_ppb).doubt_ms(now_ms, abs(drift_ppb) + spare_ppb)


def rings(alarms: AlarmClock, period_ms: int, facts: list[tuple[int, int]], until_ms: int) -> tuple[int, int]:
    """The number of alarms and the largest reading; `facts` are (time, how far the clock is set ahead of the truth)."""
    rang = latest_ms = set_ms = 0
    for at_ms, ahead_ms in [*facts, (until_ms, 0)]:
        while (due_ms := alarms.alarm_ms(period_ms, set_ms)) <= at_ms:
            rang += 1
            # It rings no earlier than its reading, and no later than its reading or the beacon that set the clock past it.
            assert alarms.reading_at(due_ms) >= rang * period_ms
            assert due_ms == set_ms or alarms.reading_at(due_ms - 1) < rang * period_ms
            alarms.rang(period_ms)
        latest_ms = max(latest_ms, alarms.reading_at(at_ms))
        if at_ms < until_ms:
            alarms.set(max(0, at_ms + ahead_ms), period_ms, at_ms)
            set_ms = at_ms
            latest_ms = max(latest_ms, alarms.reading_at(at_ms))
    return rang, latest_ms


@given(
    DRIFTS,
    st.integers(2000, 50_000),
    st.lists(st.tuples(st.integers(0, 500_000), st.integers(-900, 900)), max_size=8),
)
def test_every_multiple_rings_and_none_twice_however_the_clock_is_corrected(
    drift_ppb: int, period_ms: int, raw: list[tuple[int, int]]
) -> None:
    rang, latest_ms = rings(AlarmClock(Clock(0, 0, drift_ppb), 0), period_ms, sorted(raw), 600_000)
    assert rang == latest_ms // period_ms


def test_a_clock_set_past_an_alarm_rings_at_once_and_one_set_back_does_not_ring_again() -> None:
    alarms = AlarmClock(Clock(0, 0, 0), 0)
    alarms.set(3_600_100, 3_600_000, 3_590_000)
    assert alarms.corrected_ms == -10_100 and alarms.alarm_ms(3_600_000, 3_590_000) == 3_590_000
    alarms.rang(3_600_000)
    alarms.set(3_599_000, 3_600_000, 3_591_000)
    assert alarms.corrected_ms == 2100
    assert alarms.alarm_ms(3_600_000, 3_591_000) == 3_591_000 + 7_200_000 - 3_599_000


def test_alarms_that_were_slept_through_do_not_ring_later() -> None:
    alarms = AlarmClock(Clock(0, 0, 0), 0)
    alarms.pass_over(1000, 10_500)
    assert alarms.alarm_ms(1000, 10_500) == 11_000


@pytest.mark.parametrize(
    ("reading_ms", "next_ms"),
    [
        pytest.param(11_800, 13_000, id="by less than a period"),
        pytest.param(11_500, 13_000, id="by exactly one"),
        pytest.param(11_499, 12_000, id="by more"),
        pytest.param(0, 1000, id="to 0"),
    ],
)
def test_a_clock_set_back_by_more_than_a_period_begins_a_new_count(reading_ms: int, next_ms: int) -> None:
    alarms = AlarmClock(Clock(0, 0, 0), 0)
    alarms.pass_over(1000, 12_500)
    alarms.set(reading_ms, 1000, 12_500)
    assert alarms.alarm_ms(1000, 12_500) == 12_500 + next_ms - reading_ms


@given(
    DRIFTS,
    st.lists(st.tuples(st.integers(1, DAY_MS), st.integers(1000, DAY_MS), TIMES | st.none()), max_size=8),
)
def test_no_alarm_is_more_than_two_periods_away_however_clock_and_period_change(
    drift_ppb: int, changes: list[tuple[int, int, int | None]]
) -> None:
    clock, now_ms = Clock(0, 0, drift_ppb), 0
    alarms = AlarmClock(clock, 0)
    for later_ms, period_ms, told_ms in changes:
        now_ms += later_ms
        if told_ms is not None:
            alarms.set(told_ms, period_ms, now_ms)
        else:
            alarms.pass_over(period_ms, now_ms)
        assert alarms.alarm_ms(period_ms, now_ms) <= clock.when(clock.reading_at(now_ms) + 2 * period_ms)
