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


def at_corners(locator: Locator, count: int, **errors_m: float) -> list[PlaceFixed | None]:
    return [locator.take(taken(10 * n, *CORNERS[n], errors_m.get(f"at{n}", 0.0)), None) for n in range(count)]


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


@pytest.fixture
def locator() -> Locator:
    return Locator(CONFIG, 10.0)


def test_ranges_from_one_place_count_once(locator: Locator) -> None:
    assert [locator.take(taken(n, 0.1 * n, 0.0), None) for n in range(5)] == [None] * 5
    assert locator.dropped["no fix: too few ranges from places apart"] == 5


def test_from_a_straight_way_only_what_is_believed_says_which_side() -> None:
    """The aPad moves along east 0, so 40 m east and 40 m west fit equally."""
    for near_m, expected in (((28.0, 30.0), 40.0), ((28.0, -35.0), -40.0)):
        locator = Locator(CONFIG, 10.0)
        fixes = [locator.take(taken(n, 20.0 * n, 0.0), near_m) for n in range(4)]
        assert (fixes[-1].north_m, fixes[-1].east_m) == pytest.approx((30, expected), abs=1e-3)
    locator = Locator(CONFIG, 10.0)
    assert [locator.take(taken(n, 20.0 * n, 0.0), None) for n in range(4)] == [None] * 4
    assert locator.dropped["no fix: the anchors lie on a line, and both its sides fit"] == 2


def test_one_wrong_range_is_left_out() -> None:
    *_, last = at_corners(Locator(CONFIG, 10.0), 6, at4=5.0)
    assert last is not None and last.ranges == 5
    assert (last.north_m, last.east_m) == pytest.approx(TRUE[:2], abs=1e-3)


def test_ranges_that_contradict_each_other_give_nothing(locator: Locator) -> None:
    assert at_corners(locator, 4, at0=6.0, at2=6.0)[-1] is None
    assert locator.dropped["no fix: the ranges contradict each other"] == 2


def test_what_is_old_or_from_before_a_move_is_forgotten(locator: Locator) -> None:
    assert at_corners(locator, 3)[-1] is not None
    assert locator.take(taken(700, 0.0, 80.0), None) is None
    assert at_corners(locator, 3)[-1] is not None
    locator.forget(7)
    assert locator.take(taken(31, 0.0, 80.0), None) is None


def test_a_flat_geometry_is_no_fix(locator: Locator) -> None:
    """Ranges from 2, 4 and 6 m along the line of sight 40 m away give nothing across that line."""
    ways = [(taken(n, 30.0 + 0.05 * n, 2.5 * n)) for n in range(3)]
    assert [locator.take(it, (30.0, 40.0)) for it in ways] == [None] * 3
    assert sum(locator.dropped.values()) == 3


def test_what_is_no_length_is_dropped(locator: Locator) -> None:
    for range_m in (math.nan, -1.0, 1e308):
        assert locator.take(RangeTaken(0, 7, range_m, 0, 0, 0), None) is None
    assert locator.dropped == {"a range: range_m is outside 0 to 100000": 3}
