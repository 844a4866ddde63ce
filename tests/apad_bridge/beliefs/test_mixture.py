from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from apad_bridge.beliefs.mixture import (
    Gaussian,
    below,
    below_strictly,
    clamped,
    interval,
    quantile,
    truncated,
)

MEANS = st.floats(-0.5, 1.5)
DEVIATIONS = st.floats(0.005, 0.6)


def on_a_grid(mean: float, sd: float) -> tuple[np.ndarray, np.ndarray]:
    """Charges and their weights before clamping, by brute force."""
    z = np.linspace(-9, 9, 100_001)
    weights = np.exp(-0.5 * z**2)
    return mean + sd * z, weights / weights.sum()


@settings(max_examples=40, deadline=None)
@given(mean=MEANS, sd=DEVIATIONS)
def test_moments_are_those_of_what_rests_at_the_ends_or_of_what_is_possible(mean: float, sd: float) -> None:
    charge, weights = on_a_grid(mean, sd)
    possible = (charge >= 0) & (charge <= 1)
    kinds = [(clamped, np.clip(charge, 0, 1), weights)]
    if sd >= 0.1 and -0.2 <= mean <= 1.2:
        kinds.append((truncated, charge[possible], weights[possible] / weights[possible].sum()))
    for moments, held, share in kinds:
        expected = float(share @ held)
        by_force = expected, float(share @ (held - expected) ** 2)
        assert moments(mean, sd**2) == pytest.approx(by_force, abs=1e-4)


@settings(max_examples=40, deadline=None)
@given(mean=st.floats(-50, 50), sd=st.floats(0, 10))
def test_moments_stay_possible_however_far_outside(mean: float, sd: float) -> None:
    for moments in (clamped, truncated):
        found, variance = moments(mean, sd**2)
        assert 0 <= found <= 1
        assert 0 <= variance <= max(0.26, sd**2) and variance <= sd**2 + 1e-12


@settings(max_examples=40, deadline=None)
@given(
    st.lists(st.tuples(st.floats(0.1, 1), MEANS, DEVIATIONS), min_size=1, max_size=4),
    st.floats(0.01, 0.99),
)
def test_a_quantile_is_the_inverse_of_the_distribution(
    rows: list[tuple[float, float, float]], probability: float
) -> None:
    total = sum(weight for weight, _, _ in rows)
    parts = [Gaussian(weight / total, mean, sd) for weight, mean, sd in rows]
    charge = quantile(parts, probability)
    assert 0 <= charge <= 1
    assert below(parts, charge) >= probability - 1e-9
    assert below_strictly(parts, charge) <= probability + 1e-6


def test_an_interval_holds_95_of_100() -> None:
    assert interval([Gaussian(1.0, 0.5, 0.1)], 0.95) == pytest.approx((0.304, 0.696), abs=1e-3)
    # One in twenty is far off: the Gaussian of the same moments would give 0.33 to 0.63.
    low, high = interval([Gaussian(0.95, 0.5, 0.001), Gaussian(0.05, 0.2, 0.001)], 0.95)
    assert low == pytest.approx(0.2, abs=0.01) and high == pytest.approx(0.502, abs=0.003)


def test_what_rests_at_an_end_is_counted_there() -> None:
    parts = [Gaussian(1.0, 1.2, 0.1)]
    assert interval(parts, 0.95)[1] == 1.0 and below(parts, 1.0) == 1.0
    assert below_strictly(parts, 1.0) == pytest.approx(0.0228, abs=1e-4)
    assert quantile([Gaussian(1.0, -0.2, 0.1)], 0.5) == 0.0


def test_a_probability_is_never_above_1_though_weights_are_rounded() -> None:
    # The weights are one unit in the last place too heavy; all parts lie at 0 for certain.
    parts = [Gaussian(weight, -0.4, 0.005) for weight in (0.5, 0.5 + 2**-52)]
    assert sum(weight for weight, _, _ in parts) > 1
    assert below(parts, 0.0) == below_strictly(parts, 0.5) == 1.0
