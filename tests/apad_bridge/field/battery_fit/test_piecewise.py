"""Tests the fit against known curves, against the curve under added noise, and against an exhaustive search."""

from itertools import combinations

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from apad_bridge.field.battery_fit.piecewise import MIN_ROWS, Floats, fit


def polyline(x: Floats, knots: list[float], start: float, slopes: list[float]) -> Floats:
    """The curve at `x`, by summing hinges and not by interpolation."""
    y = start + slopes[0] * (x - knots[0])
    for knot, before, after in zip(knots[1:-1], slopes, slopes[1:], strict=False):
        y = y + (after - before) * np.maximum(0.0, x - knot)
    return y


@st.composite
def curves(draw: st.DrawFn) -> tuple[list[float], list[float]]:
    """Draws (knots from 0 to 100 at least 10 apart, slopes with clearly different neighbours)."""
    count = draw(st.integers(1, 5))
    widths = [draw(st.floats(1, 3)) for _ in range(count)]
    knots = [0.0, *(float(k) for k in np.cumsum(widths) / sum(widths) * 100)]
    slope = draw(st.floats(0.5, 2))
    slopes = [slope]
    for _ in range(count - 1):
        slope += draw(st.sampled_from([-1, 1])) * draw(st.floats(1, 2))
        slopes.append(slope)
    return knots, slopes


@settings(deadline=None, max_examples=30)
@given(curves())
def test_a_curve_without_noise_is_found(curve: tuple[list[float], list[float]]) -> None:
    knots, slopes = curve
    x = np.linspace(0, 100, 401)
    found = fit(x, polyline(x, knots, 3.0, slopes), len(slopes))
    assert found.knots == pytest.approx(knots, abs=0.02)
    assert found.slopes == pytest.approx(slopes, abs=0.01)


@settings(deadline=None, max_examples=30)
@given(curves(), st.integers(0, 2**32 - 1), st.floats(0.01, 3))
@example(([0.0, 22.568, 47.471, 70.039, 83.658, 100.0], [1.0, 0.0, -1.0, 0.0, 1.0]), 5, 2.0)
def test_no_curve_of_as_many_pieces_fits_better_than_the_fit(
    curve: tuple[list[float], list[float]], seed: int, noise: float
) -> None:
    knots, slopes = curve
    x = np.sort(np.random.default_rng(seed).uniform(0, 100, 300))
    truth = polyline(x, knots, 0.0, slopes)
    y = truth + np.random.default_rng(seed + 1).normal(0, noise, len(x))
    found = fit(x, y, len(slopes))
    assert np.sum((y - found.at(x)) ** 2) <= np.sum((y - truth) ** 2)
    if len(slopes) > 1:
        fewer = fit(x, y, len(slopes) - 1)
        assert np.sum((y - found.at(x)) ** 2) <= np.sum((y - fewer.at(x)) ** 2) * (1 + 1e-9)


@pytest.mark.parametrize("segments", [2, 3])
@pytest.mark.parametrize("seed", range(4))
def test_the_fit_is_as_good_as_trying_every_breakpoint(segments: int, seed: int) -> None:
    random = np.random.default_rng(seed)
    x = np.sort(random.uniform(0, 10, 40))
    y = np.cumsum(random.normal(0, 1, 40))  # a random walk, which follows no curve
    best = np.inf
    for chosen in combinations(np.linspace(0, 10, 81)[1:-1], segments - 1):
        edges = np.searchsorted(x, [x[0], *chosen])
        if min(np.diff([*edges, len(x)])) < MIN_ROWS:
            continue
        basis = np.column_stack([np.ones(40), x, *(np.maximum(0, x - knot) for knot in chosen)])
        _, squares, _, _ = np.linalg.lstsq(basis, y, rcond=None)
        best = min(best, float(squares[0]))
    assert np.sum((y - fit(x, y, segments).at(x)) ** 2) <= best * (1 + 1e-9)


def test_a_straight_line_is_the_textbook_s() -> None:
    x = np.array([0.0, 1.0, 2.0, 5.0])
    y = np.array([1.0, 2.0, 4.0, 9.0])
    # Sxy = 21, Sxx = 14 about the means 2 and 4.
    found = fit(x, y, 1)
    assert found.slopes == pytest.approx((23 / 14,))
    assert found.values[0] == pytest.approx(4 - 2 * 23 / 14)


def test_every_segment_keeps_its_rows() -> None:
    x = np.arange(13.0)
    assert np.histogram(x, fit(x, np.where(x == 6, 5.0, 0.0), 4).knots)[0].min() >= MIN_ROWS


@pytest.mark.parametrize(
    ("x", "segments", "message"),
    [
        ([0.0, 1.0, 2.0], 1, "3 rows are too few for 1 segments: 4 at least"),
        ([2.0] * 9, 1, "too few"),
        ([0.0, 1.0, 2.0, 3.0, 4.0, 5.0], 2, "7 at least"),
        ([0.0] * 9 + [1.0], 2, "too close together"),
        ([0.0, 1.0, 2.0, 3.0], 0, "one segment or more"),
    ],
)
def test_what_cannot_be_fitted_is_refused(x: list[float], segments: int, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        fit(np.array(x), np.zeros(len(x)), segments)
