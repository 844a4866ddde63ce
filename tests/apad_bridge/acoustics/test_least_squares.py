"""Tests places from ranges against geometry by hand, and against many draws of noise."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from apad_bridge.acoustics.least_squares import NoFix, mirrored, solve

SQUARE = np.array([(0.0, 0.0, 0.5), (0.0, 100.0, 0.5), (100.0, 0.0, 0.5), (100.0, 100.0, 0.5)])


def ranges_to(place: tuple[float, float, float], anchors: np.ndarray) -> np.ndarray:
    lengths: np.ndarray = np.linalg.norm(anchors - np.array(place), axis=1)
    return lengths


@settings(max_examples=100, deadline=None)
@given(st.floats(1, 99), st.floats(1, 99), st.floats(1, 30))
def test_exact_ranges_give_the_exact_place(north_m: float, east_m: float, depth_m: float) -> None:
    found = solve(
        SQUARE, ranges_to((north_m, east_m, depth_m), SQUARE), np.full(4, 0.1), depth_m, (50.0, 50.0)
    )
    assert (found.north_m, found.east_m) == pytest.approx((north_m, east_m), abs=1e-5)
    assert found.residuals_m == pytest.approx([0] * 4, abs=1e-5)


FLAT = np.array([(0.0, 0.0, 5.0), (0.0, 100.0, 5.0), (100.0, 0.0, 5.0), (100.0, 100.0, 5.0)])
CORNER = np.array([(0.0, 0.0, 2.0), (30.0, 40.0, 2.0)])


@pytest.mark.parametrize(
    ("anchors", "place", "deviations_m", "near_m", "hdop", "covariance"),
    [
        # Amid four anchors at its depth every unit vector is (+-1, +-1)/sqrt 2, so J^T J = 2 I and HDOP is 1.
        pytest.param(
            FLAT,
            (50, 50, 5),
            [0.2] * 4,
            (40.0, 45.0),
            1.0,
            (0.02, 0, 0.02),
            id="amid four anchors",
        ),
        # Each range fixes one axis: HDOP is sqrt 2, and each variance is that of its own range.
        pytest.param(
            CORNER,
            (30, 0, 2),
            [0.1, 0.3],
            (28.0, 3.0),
            2**0.5,
            (0.01, 0, 0.09),
            id="two anchors at a right angle",
        ),
    ],
)
def test_dilution_by_hand(
    anchors: np.ndarray,
    place: tuple[float, float, float],
    deviations_m: list[float],
    near_m: tuple[float, float],
    hdop: float,
    covariance: tuple[float, float, float],
) -> None:
    found = solve(anchors, ranges_to(place, anchors), np.array(deviations_m), place[2], near_m)
    assert (found.north_m, found.east_m) == pytest.approx(place[:2], abs=1e-6)
    assert found.hdop == pytest.approx(hdop)
    assert found.covariance == pytest.approx(covariance, abs=1e-9)


def test_a_better_range_counts_for_more() -> None:
    """Two ranges: from the south 1 m too long, from the north exact with a tenth of the deviation.

    On the line the place is the weighted mean: (1 * 101 + 100 * 100) / 101.
    """
    anchors = np.array([(0.0, 0.0, 0.0), (200.0, 0.0, 0.0), (100.0, 300.0, 0.0), (100.0, -300.0, 0.0)])
    found = solve(anchors, np.array([101.0, 100.0, 300.0, 300.0]), np.array([1, 0.1, 1, 1]), 0.0, (95.0, 5.0))
    assert found.north_m == pytest.approx((101 + 100 * 100) / 101, abs=1e-3)


def test_the_covariance_is_that_of_many_draws() -> None:
    """2000 draws of 0.5 m: variances within four standard errors (a variance's is sqrt(2/2000) = 3.2 % of it)."""
    draw = np.random.default_rng(4)
    true = (20.0, 70.0, 8.0)
    deviations = np.array([0.5, 0.5, 0.3, 0.8])
    noisy = (ranges_to(true, SQUARE) + draw.normal(0, deviations) for _ in range(2000))
    founds = [solve(SQUARE, it, deviations, 8.0, (50.0, 50.0)) for it in noisy]
    north, cross, east = founds[0].covariance
    places = np.array([(it.north_m, it.east_m) for it in founds])
    spread = np.cov(places.T)
    assert spread[0, 0] == pytest.approx(north, rel=0.13)
    assert spread[1, 1] == pytest.approx(east, rel=0.13)
    assert spread[0, 1] == pytest.approx(cross, abs=0.13 * (north * east) ** 0.5)
    # With four ranges and two unknowns the residuals have two degrees of freedom.
    assert np.mean([it.chi2 for it in founds]) == pytest.approx(2, abs=4 * (4 / 2000) ** 0.5)


def test_a_line_through_the_aMussel_fixes_nothing() -> None:
    anchors = np.array([(0.0, 0.0, 1.0), (10.0, 0.0, 1.0), (20.0, 0.0, 1.0)])
    with pytest.raises(NoFix, match="lie on a line"):
        solve(anchors, np.array([50.0, 40.0, 30.0]), np.full(3, 0.1), 1.0, (50.0, 0.0))


def test_the_mirror_lies_as_far_beyond_the_line() -> None:
    anchors = np.array([(0.0, 5.0, 1.0), (10.0, 5.0, 1.0), (30.0, 5.0, 1.0)])
    assert mirrored(anchors, (7.0, 12.0)) == pytest.approx((7, -2))
