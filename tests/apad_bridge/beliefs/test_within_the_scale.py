"""The effect of the ends of the scale on an estimate, against brute force; and updates by readings at an end."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from apad_bridge.beliefs.charge_filter import ASLEEP, CHARGING, PRIMARY, SECONDARY, SIZE, bounded, measured
from apad_bridge.beliefs.charge_filter import SENSOR as SENSOR_BIAS
from apad_bridge.beliefs.modes import Mode
from apad_bridge.beliefs.twin_parameters import SensorParameters

SENSOR = SensorParameters(0.005, (0.0,) * 4, (0.02,) * 4, 300_000)
METERED = SensorParameters(0.005, (0.0,) * 4, (0.02,) * 4, 300_000, saturates=True)
Array = NDArray[np.float64]


def state(primary: float, sd: float, bias: int, bias_sd: float, correlation: float) -> tuple[Array, Array]:
    """A state whose secondary and drain are known."""
    mean = np.zeros(SIZE)
    mean[PRIMARY], mean[SECONDARY] = primary, 0.5
    cov = np.zeros((SIZE, SIZE))
    cov[PRIMARY, PRIMARY], cov[bias, bias] = sd**2, bias_sd**2
    cov[PRIMARY, bias] = cov[bias, PRIMARY] = correlation * sd * bias_sd
    return mean, cov


def many(mean: Array, cov: Array, bias: int) -> Array:
    pair = [PRIMARY, bias]
    return np.random.default_rng(5).multivariate_normal(mean[pair], cov[np.ix_(pair, pair)], 400_000)


@pytest.mark.parametrize(("primary", "correlation"), [(0.98, -0.97), (1.01, -0.5), (0.03, 0.8)])
@pytest.mark.parametrize("after_measuring", [True, False])
def test_what_a_charge_cannot_be_teaches_what_goes_with_it_after_measuring_alone(
    primary: float, correlation: float, after_measuring: bool
) -> None:
    """Else it is held at the end, and teaches nothing else."""
    mean, cov = state(primary, 0.02, ASLEEP, 0.015, correlation)
    drawn = many(mean, cov, ASLEEP)
    held = np.column_stack([drawn[:, 0].clip(0, 1), drawn[:, 1]])
    drawn = drawn[(drawn[:, 0] >= 0) & (drawn[:, 0] <= 1)] if after_measuring else held
    found, spread = bounded(mean, cov, after_measuring=after_measuring)
    assert found[[PRIMARY, ASLEEP]] == pytest.approx(drawn.mean(axis=0), abs=2e-4)
    assert spread[np.ix_([PRIMARY, ASLEEP], [PRIMARY, ASLEEP])] == pytest.approx(np.cov(drawn.T), abs=4e-6)


def test_an_end_of_the_scale_is_not_counted_at_every_reading() -> None:
    """A reading of 0.99 may contain a bias of 0.02. Spending gives no information about it, so the first error stays."""
    mean, cov = state(0.5, 0.6, ASLEEP, 0.02, 0.0)
    cov[SECONDARY, SECONDARY] = 1e-6
    away = []
    for n in range(8):
        read = 0.99 - 0.012 * n
        mean, cov, _, _ = measured(mean, cov, SENSOR, Mode.ASLEEP, (read, 0.5))
        mean, cov = bounded(mean, cov, after_measuring=True)
        away.append(float(mean[PRIMARY]) - read)
        mean[PRIMARY] -= 0.012
    # The mean of a Gaussian of 0.99 and 0.02 below 1 is 0.99 - 0.02 pdf(0.5) / cdf(0.5) = 0.9798.
    assert away[0] == pytest.approx(-0.0102, abs=0.001)
    assert away[-1] == pytest.approx(away[0], abs=0.002)


def test_a_full_battery_on_a_charger_says_nothing_of_the_lift() -> None:
    mean, cov = state(0.7, 0.01, CHARGING, 0.02, 0.0)
    mean[SECONDARY], cov[SECONDARY, SECONDARY] = 0.99, 1e-4
    for n in range(20):
        read = 0.7 + 0.01 * n
        mean[PRIMARY] = read
        mean, cov, _, _ = measured(mean, cov, SENSOR, Mode.CHARGING_PRIMARY, (read, 1.0))
    assert mean[CHARGING] == pytest.approx(0.0, abs=1e-3)
    # The secondary is full, or its lift makes it seem full: no number of such readings decides between them.
    assert mean[SECONDARY] > 0.995 and cov[SECONDARY, SECONDARY] > 0.004**2


@pytest.mark.parametrize(
    ("charge", "reading", "least", "most", "surprises"),
    [
        # 0.004 below the held voltage are 0.8 deviations of the noise.
        (0.985, 0.996, 0.984, 0.986, (0.8, 0.8)),
        (0.93, 0.996, 0.945, 1.0, (2.0, np.inf)),
        # A lower reading is the charge plus the lift.
        (0.93, 0.965, 0.925, 0.927, (0.0, 2.0)),
    ],
)
def test_a_voltage_that_is_held_at_the_full_one_is_not_what_the_battery_holds(
    charge: float, reading: float, least: float, most: float, surprises: tuple[float, float]
) -> None:
    """At a lift of 0.04, a charge from 0.956 on reads 0.996: the noise of a voltage that the charger holds."""
    mean, cov = state(charge, 0.01, CHARGING, 0.002, 0.0)
    found, _, _, surprise = measured(mean, cov, METERED, Mode.CHARGING_PRIMARY, (reading, 0.99), (0.04, 0.04))
    assert least <= found[PRIMARY] <= most and surprises[0] - 1e-6 <= surprise <= surprises[1] + 1e-6


def test_the_noise_of_a_held_voltage_is_no_bias() -> None:
    """2000 full batteries on a charger with a known lift and an unknown bias: 10 read more than 2.5 deviations low."""
    luck = np.random.default_rng(7)
    for reading in np.minimum(1.0, 1 + luck.normal(0, METERED.noise, 2000)):
        mean, cov = state(1.0, 1e-4, SENSOR_BIAS, 0.0135, 0.0)
        both = (float(reading), 0.99)
        found, _, _, _ = measured(mean, cov, METERED, Mode.CHARGING_PRIMARY, both, (0.0436, 0.0436))
        assert abs(found[SENSOR_BIAS]) < 0.0135, reading


def test_who_would_read_beyond_the_scale_does_not_surprise_at_its_end() -> None:
    mean, cov = state(1.0, 0.002, CHARGING, 0.002, 0.0)
    _, _, _, surprise = measured(mean, cov, SENSOR, Mode.FULL, (1.0, 1.0), (0.04, 0.04))
    assert surprise == 0.0
    _, _, _, surprise = measured(mean, cov, SENSOR, Mode.FULL, (0.9, 1.0), (0.04, 0.04))
    assert surprise > 10
