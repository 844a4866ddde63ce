"""Currents by depth and time against hand calculations; files that are refused."""

from __future__ import annotations

from array import array

import pytest
from hypothesis import given
from hypothesis import strategies as st

from agents.water.current_field import CurrentField
from agents.water.water_current import STILL, TideConstituent, WaterCurrent, parse_water_current, steady

HEADER = "north_m,east_m,north_m_s,east_m_s,depth_m,time_s\n"
LAYERED = parse_water_current(HEADER + "0,0,1,0,0,0\n0,0,0.2,0,10,0\n0,0,3,0,0,100\n0,0,0.4,0.1,10,100\n")


@pytest.mark.parametrize(
    ("depth_m", "second", "velocity"),
    [
        (0, 0, (1_000_000, 0)),
        (10, 0, (200_000, 0)),
        (5, 0, (600_000, 0)),
        (0, 50, (2_000_000, 0)),
        (5, 50, (1_150_000, 25_000)),
        (99, 999, (400_000, 100_000)),
    ],
)
def test_between_depths_and_times_it_is_linear(depth_m: int, second: int, velocity: tuple[int, int]) -> None:
    assert LAYERED.velocity_um_s(7, -3, depth_m * 1_000_000, second) == velocity


def test_a_tide_turns() -> None:
    """12 h: north is at its height after 3 h, east a quarter later; after 6 h both have turned."""
    tide = WaterCurrent.of(
        STILL.seconds, STILL.depths_um, STILL.fields, (TideConstituent(43_200, 500_000, 200_000, 0, 750_000),)
    )
    hours = [tide.velocity_um_s(0, 0, 0, 3600 * hour) for hour in (0, 3, 6, 9, 12)]
    assert hours == [(0, -200_000), (500_000, 0), (0, 200_000), (-500_000, 0), (0, -200_000)]
    assert tide.velocity_um_s(0, 0, 0, 3600)[0] == 250_000  # sin 30 degrees
    assert not tide.is_still


@given(st.integers(0, 10**9))
def test_a_tide_comes_back_after_its_period_exactly(second: int) -> None:
    tide = TideConstituent(44_714, 311_000, -92_000, 123_456, 7)
    assert tide.velocity_um_s(second) == tide.velocity_um_s(second + 44_714)


def test_near_the_bottom_less_is_left() -> None:
    river = WaterCurrent.of(
        array("q", [0]),
        array("q", [0]),
        (CurrentField.parse("north_m,east_m,north_m_s,east_m_s\n0,0,0.5,-0.5\n"),),
        (),
        ((2_000_000, 1_000_000), (10_000_000, 200_000)),
    )
    norths = [river.velocity_um_s(0, 0, depth * 1_000_000, 0)[0] for depth in (0, 2, 6, 10, 11)]
    assert norths == [500_000, 500_000, 300_000, 100_000, 100_000]


def test_a_file_without_depth_and_time_is_one_field() -> None:
    text = "north_m,east_m,north_m_s,east_m_s\n0,0,0.5,0\n"
    assert parse_water_current(text) == steady(CurrentField.parse(text))
    assert STILL.is_still and not parse_water_current(text).is_still


@pytest.mark.parametrize(
    ("rows", "error"),
    [
        ("", "only a header"),
        ("0,0,1,0,0\n", "line 2: 5 values for 6 columns"),
        ("0,0,1,0,deep,0\n", "line 2: time_s and depth_m: must be numbers"),
        ("0,0,1,0,0,0\n0,0,1,0,5,0\n0,0,1,0,0,9\n", "nothing for time_s 9, depth_m 5"),
        ("0,0,1,0,0,0\n0,0,1,0,5,0\n0,0,fast,0,5,0\n", "line 4: .*north_m_s"),
    ],
)
def test_what_is_no_stream_is_refused(rows: str, error: str) -> None:
    with pytest.raises(ValueError, match=error):
        parse_water_current(HEADER + rows)
