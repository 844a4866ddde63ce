"""Tests fixes from a moving aPad's ranges: when there is one, the side of a line, outliers, and dropped ranges."""

from __future__ import annotations

import math

import pytest

from apad_bridge.acoustics.locator import Locator, RangeTaken
from apad_bridge.events.sound_events import PlaceFixed
from apad_bridge.scenario.water.water_options import Localisation

CONFIG = Localisation(deviation_m=0.1, memory_s=600.0, apart_m=2.0)
TRUE = (30.0, 40.0, 10.0)
CORNERS = ((0.0, 0.0), (60.0, 0.0), (60.0, 80.0), (0.0, 80.0), (30.0, -10.0), (70.0, 40.0))


def taken(at_s: int, north_m: float, east_m: float, error_m: float = 0.0) -> RangeTaken:
    return RangeTaken(1000 * at_s, 7, math.dist((north_m, east_m, 0.5), TRUE) + error_m, north_m, east_m, 0.5)


def at_corners(locator: Locator, count: int) -> list[PlaceFixed | None]:
    return [locator.take(it, None) for it in corners(count)]


def test_the_third_range_from_elsewhere_gives_a_fix() -> None:
    first, second, third, fourth = at_corners(Locator(CONFIG, 10.0), 4)
    assert first is None and second is None
    assert third is not None and fourth is not None
    assert (third.north_m, third.east_m) == pytest.approx(TRUE[:2], abs=1e-4)
    assert (fourth.ranges, fourth.id) == (4, 7)
    # Horizontal unit vectors from the corners of 60 x 80 m: (+-30, +-40) / sqrt(30^2 + 40^2 + 9.5^2).
    squared = 50**2 + 9.5**2
    hdop = math.sqrt(squared / (4 * 30**2) + squared / (4 * 40**2))
    assert fourth.hdop == pytest.approx(hdop, rel=1e-6)
    assert fourth.covariance[0] == pytest.approx(0.01 * squared / (4 * 30**2), rel=1e-6)
    assert fourth.residual_m == pytest.approx(0, abs=1e-5)


def corners(count: int, **errors_m: float) -> list[RangeTaken]:
    return [taken(10 * n, *CORNERS[n], errors_m.get(f"at{n}", 0.0)) for n in range(count)]


ON_A_LINE = [taken(n, 20.0 * n, 0.0) for n in range(4)]
FEW, LINE = (
    "no fix: too few ranges from places apart",
    "no fix: the anchors lie on a line, and both its sides fit",
)
Near = tuple[float, float] | None
FIXES: dict[str, tuple[list[RangeTaken], Near, tuple[float, float] | None, dict[str, int]]] = {
    # What is taken, what is believed, the last fix, and what was dropped.
    "ranges from one place count once": ([taken(n, 0.1 * n, 0.0) for n in range(5)], None, None, {FEW: 5}),
    # The aPad moves along east 0, so 40 m east and 40 m west fit equally.
    "from a straight way what is believed says which side: east": (
        ON_A_LINE,
        (28.0, 30.0),
        (30, 40),
        {FEW: 2},
    ),
    "from a straight way what is believed says which side: west": (
        ON_A_LINE,
        (28.0, -35.0),
        (30, -40),
        {FEW: 2},
    ),
    "from a straight way nothing else does": (ON_A_LINE, None, None, {FEW: 2, LINE: 2}),
    "one wrong range is left out": (corners(6, at4=5.0), None, TRUE[:2], {FEW: 2}),
    "ranges that contradict each other give nothing": (
        corners(4, at0=6.0, at2=6.0),
        None,
        None,
        {FEW: 2, "no fix: the ranges contradict each other": 2},
    ),
    "what is old is forgotten": ([*corners(3), taken(700, 0.0, 80.0)], None, None, {FEW: 3}),
    # Ranges from 2, 4 and 6 m along the line of sight 40 m away give nothing across that line.
    "a flat geometry is no fix": (
        [taken(n, 30.0 + 0.05 * n, 2.5 * n) for n in range(3)],
        (30.0, 40.0),
        None,
        {FEW: 2, "no fix: the geometry is too flat": 1},
    ),
    "what is no length is dropped": (
        [RangeTaken(0, 7, range_m, 0, 0, 0) for range_m in (math.nan, -1.0, 1e308)],
        None,
        None,
        {"a range: range_m is outside 0 to 100000": 3},
    ),
}


@pytest.mark.parametrize(("ranges", "near_m", "place_m", "dropped"), FIXES.values(), ids=FIXES)
def test_what_the_last_range_fixes(
    ranges: list[RangeTaken], near_m: Near, place_m: tuple[float, float] | None, dropped: dict[str, int]
) -> None:
    locator = Locator(CONFIG, 10.0)
    fix = [locator.take(it, near_m) for it in ranges][-1]
    assert (fix is None) is (place_m is None)
    assert fix is None or (fix.north_m, fix.east_m) == pytest.approx(place_m, abs=1e-3)
    assert locator.dropped == dropped


def test_what_is_from_before_a_move_is_forgotten() -> None:
    locator = Locator(CONFIG, 10.0)
    assert at_corners(locator, 3)[-1] is not None
    locator.forget(7)
    assert locator.take(taken(31, 0.0, 80.0), None) is None
