from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from apad_bridge.beliefs.charging import Rate, charged, propagated
from apad_bridge.beliefs.twin_parameters import ChargerParameters

CURVE = ((0.16197, 0.001045), (0.5634, 0.00223), (1.0, 0.002911))
CHARGER = ChargerParameters(CURVE, primary=1.2435, deviation=0.0)


def stepped(charge: float, coils: float, load: float, minutes: int, steps: int = 60) -> float:
    """Equation (2) as the paper writes it, in small steps."""
    for _ in range(minutes * steps):
        rate = next((r for end, r in CURVE if charge <= end), CURVE[-1][1])
        charge += (coils * rate - load) / steps
    return charge


@pytest.mark.parametrize(
    ("coils", "load", "charge", "minutes", "expected"),
    [
        *(
            pytest.param(
                1.2435,
                0.00004,
                *it,
                pytest.approx(stepped(it[0], 1.2435, 0.00004, it[1]), abs=5e-4),
                id=f"the paper's difference equation, from {it[0]}",
            )
            for it in ((0.0, 100), (0.1, 300), (0.4, 90), (0.8, 20))
        ),
        pytest.param(1.0, 0.0, 0.0, 485, pytest.approx(1.0, abs=0.001), id="Table I charges in 485 minutes"),
        pytest.param(1.0, 0.0, 0.0, 470, pytest.approx(0.48, abs=0.48), id="and no earlier"),
        pytest.param(
            1.0,
            0.005,
            0.1,
            10,
            pytest.approx(0.1 - 10 * (0.005 - 0.001045)),
            id="a load above what the charger gives lowers it",
        ),
        pytest.param(1.0, 0.005, 0.01, 1000, 0.0, id="until it is empty"),
    ],
)
def test_a_charge_after_minutes(
    coils: float, load: float, charge: float, minutes: int, expected: float
) -> None:
    assert charged(CHARGER, coils, load, charge, minutes) == expected


@settings(max_examples=25, deadline=None)
@given(
    mean=st.floats(0.05, 0.8),
    sd=st.floats(0.001, 0.1),
    minutes=st.floats(0, 200),
    deviation=st.floats(0, 0.05),
)
def test_moments_are_those_of_many_batteries(
    mean: float, sd: float, minutes: float, deviation: float
) -> None:
    charger = ChargerParameters(CURVE, 1.0, deviation)
    z = np.linspace(-5, 5, 201)
    weights = np.exp(-0.5 * z**2)
    weights /= weights.sum()
    ends = np.array([charged(charger, 1.0, 0.0, min(1.0, mean + sd * float(n)), minutes) for n in z])
    expected = float(weights @ ends)
    spread = float(weights @ (ends - expected) ** 2)
    less = charged(charger, 1 - deviation, 0.0, mean, minutes)
    extra = (charged(charger, 1.0, 0.0, mean, minutes) - less) ** 2
    found, variance, slope, _ = propagated(charger, 1.0, 0.0, mean, sd**2, minutes)
    assert found == pytest.approx(expected, abs=0.01)
    assert variance == pytest.approx(spread + extra, rel=0.35, abs=2e-5)
    assert slope == pytest.approx(float(weights @ (z * ends)) / sd, rel=0.2, abs=0.05)


def test_a_charge_that_is_known_exactly_is_carried_exactly() -> None:
    found = propagated(CHARGER, 1.0, 0.0, 0.5, 0.0, 10)
    # At twice the rate it would gain twice as much: the slope on the rate is what it gains.
    assert found == (pytest.approx(0.5223), 0.0, 1.0, pytest.approx(0.0223))


def test_an_unknown_rate_spreads_what_is_gained() -> None:
    """0.0223 gained, 10 % up or down, beside a charge that goes with the rate: var = a^2 + 2 a b rho + b^2."""
    sd, of_rate, together = 0.01, 0.1, 0.5 * 0.01 * 0.1
    found = propagated(CHARGER, 1.0, 0.0, 0.45, sd**2, 10, Rate(1.0, of_rate**2, together))
    gained = 0.0223
    by_hand = sd**2 + (gained * of_rate) ** 2 + 2 * gained * together
    assert found.variance == pytest.approx(by_hand, rel=0.02) and found.by_rate == pytest.approx(gained)
    faster = propagated(CHARGER, 1.0, 0.0, 0.45, 0.0, 10, Rate(1.2, 0.0, 0.0))
    assert faster.mean == pytest.approx(0.45 + 1.2 * gained)
