"""The eight numbers of a twin's filter against calculations by hand: updates by readings, and process noise."""

from __future__ import annotations

from dataclasses import replace
from math import sqrt

import numpy as np
import pytest
from scenario_files import SOUND_FILE

from apad_bridge.assembly.flight_config import flight_config
from apad_bridge.beliefs import charge_state as charge
from apad_bridge.beliefs.charge_state import ASLEEP, CHARGING, DRAIN, PRIMARY, RATE, SECONDARY, SIZE
from apad_bridge.beliefs.modes import Mode
from apad_bridge.beliefs.spent_charge import Spent
from apad_bridge.beliefs.twin_parameters import Sensor
from apad_bridge.scenario.loader import load

SENSOR = Sensor(0.01, (0.0,) * 4, (0.01,) * 4, 300_000)
NO_NOISE = np.zeros((SIZE, SIZE))


def state(charge_1: float, charge_2: float, **variances: float) -> tuple[charge.Array, charge.Array]:
    """A state without bias, with the nominal drain and charging rate; certain, except for the variances given."""
    cov = np.zeros((SIZE, SIZE))
    for name, variance in variances.items():
        row = getattr(charge, name.upper())
        cov[row, row] = variance
    return np.array([charge_1, charge_2, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0]), cov


def test_a_charger_lifts_what_both_batteries_read() -> None:
    """Both charges are certain, so 0.03 too much in both readings is lift: two readings are worth one of half the noise,
    0.03 * 1e-4 / (1e-4 + 0.5e-4)."""
    mean, cov = state(0.5, 0.6, charging=1e-4)
    found, left, _, _ = charge.measured(mean, cov, SENSOR, Mode.CHARGING_PRIMARY, (0.53, 0.63))
    assert found[CHARGING] == pytest.approx(0.02)
    assert left[CHARGING, CHARGING] == pytest.approx(1 / (1 / 1e-4 + 2 / 1e-4))
    assert found[[PRIMARY, SECONDARY]] == pytest.approx([0.5, 0.6])


def test_a_load_moves_the_primarys_reading_alone() -> None:
    mean, cov = state(0.5, 0.6, asleep=1e-4)
    found, _, _, _ = charge.measured(mean, cov, SENSOR, Mode.ASLEEP, (0.48, 0.63))
    assert found[ASLEEP] == pytest.approx(-0.01) and found[SECONDARY] == pytest.approx(0.6)


@pytest.mark.parametrize(("together", "variance"), [(3e-4, 1.5e-3), (-3e-4, 3e-4)])
def test_a_charge_and_a_bias_that_go_together_surprise_less(together: float, variance: float) -> None:
    """The variance of the sum: 4e-4 + 4e-4 + 1e-4 of noise, and twice the covariance."""
    mean, cov = state(0.5, 0.6, primary=4e-4, asleep=4e-4)
    cov[PRIMARY, ASLEEP] = cov[ASLEEP, PRIMARY] = together
    _, _, density, surprise = charge.measured(mean, cov, SENSOR, Mode.ASLEEP, (0.56, 0.6))
    assert surprise == pytest.approx(0.06 / sqrt(variance))
    assert density == pytest.approx(-0.5 * (0.06**2 / variance + np.log(variance)))


def test_what_was_spent_goes_out_with_all_that_is_uncertain_of_it() -> None:
    """Spent are 0.2 +- 0.02 at a drain of 1.1 +- 0.1, and 0.05 +- 0.01 of the secondary."""
    mean, cov = state(0.9, 0.8, primary=1e-4, secondary=4e-4, drain=1e-2)
    mean[DRAIN] = 1.1
    after, left = charge.discharged(mean, cov, Spent(1.0, 0.2, 4e-4), (0.05, 1e-4), NO_NOISE)
    assert after[[PRIMARY, SECONDARY, DRAIN]] == pytest.approx([0.9 - 0.22, 0.75, 1.1])
    assert left[PRIMARY, PRIMARY] == pytest.approx(1e-4 + 0.2**2 * 1e-2 + (1.1**2 + 1e-2) * 4e-4)
    assert left[PRIMARY, DRAIN] == pytest.approx(-0.2 * 1e-2)
    assert left[SECONDARY, SECONDARY] == pytest.approx(5e-4)


def test_a_dock_makes_the_charge_go_with_the_charging_rate() -> None:
    """Charge 0.5 +- 0.02, rate 1 +- 0.1, by hand: slopes of 1 on the charge and of 0.3 on the rate, 0.3 gained."""
    mean, cov = state(0.5, 0.9, primary=4e-4, rate=1e-2)
    variance = 4e-4 + 0.3**2 * 1e-2
    after, left = charge.charged(mean, cov, [(0.8, variance, 1.0, 0.3), (0.95, 0.0, 1.0, 0.0)], NO_NOISE)
    assert after[[PRIMARY, SECONDARY, RATE]] == pytest.approx([0.8, 0.95, 1.0])
    assert left[PRIMARY, PRIMARY] == pytest.approx(variance)
    assert left[PRIMARY, RATE] == pytest.approx(0.3 * 1e-2)
    # A reading 0.06 above the expectation is a faster charger, to 0.3e-2 / (13e-4 + 1e-4) of it.
    found, _, _, _ = charge.measured(after, left, SENSOR, Mode.CHARGING_PRIMARY, (0.86, 0.95))
    assert found[RATE] == pytest.approx(1 + 0.06 * 0.3e-2 / (variance + 1e-4), rel=1e-3)


def test_drain_and_biases_wander_by_a_days_deviation_in_a_day() -> None:
    """Random walks: after four days the deviation is twice that of one day. A bias wanders by 15 % of 0.02."""
    scenario = load(SOUND_FILE)
    twin = flight_config(scenario).twin
    assert twin is not None
    parameters = replace(twin.parameters, ageing_per_day=0.002)
    for days, deviation in ((1, 0.002), (4, 0.004)):
        noise = charge.process_noise(parameters, days * 86_400_000)
        assert sqrt(noise[DRAIN, DRAIN]) == pytest.approx(deviation)
        assert np.sqrt(noise[[ASLEEP, CHARGING], [ASLEEP, CHARGING]]) == pytest.approx(
            [0.003 * sqrt(days)] * 2
        )
        assert np.count_nonzero(noise) == 5
