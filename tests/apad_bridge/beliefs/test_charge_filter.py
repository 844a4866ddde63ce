"""The numbers of a twin's filter against calculations by hand: updates by readings, and process noise."""

from __future__ import annotations

from dataclasses import replace
from math import sqrt

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scenario_files import SOUND_FILE

from apad_bridge.assembly.flight_config import flight_config
from apad_bridge.beliefs import charge_filter as charge
from apad_bridge.beliefs.charge_filter import ASLEEP, CHARGING, DRAIN, PRIMARY, RATE, SECONDARY, SIZE, SWING
from apad_bridge.beliefs.charge_filter import SENSOR as BIAS
from apad_bridge.beliefs.modes import Mode
from apad_bridge.beliefs.spent_charge import Spent
from apad_bridge.beliefs.twin_parameters import SensorParameters, TwinParameters, UntoldParameters
from apad_bridge.scenario.loader import load
from firmware_model.power.charge import FULL
from firmware_model.power.voltage_curve import VoltageCurve

SENSOR = SensorParameters(0.01, (0.0,) * 4, (0.01,) * 4, 300_000)
NO_NOISE = np.zeros((SIZE, SIZE))


def state(charge_1: float, charge_2: float, **variances: float) -> tuple[charge.Array, charge.Array]:
    """A state without bias, with the nominal drain and charging rate; certain, except for the variances given."""
    cov = np.zeros((SIZE, SIZE))
    for name, variance in variances.items():
        row = getattr(charge, name.upper())
        cov[row, row] = variance
    return np.array([charge_1, charge_2, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0]), cov


def told_of_a_swing(deviation: float) -> TwinParameters:
    twin = flight_config(load(SOUND_FILE)).twin
    return replace(twin.parameters, untold=UntoldParameters(0.4, 0.2, 0.05, deviation))


def swinging(swing: float, variance: float) -> tuple[charge.Array, charge.Array]:
    """A certain state, but for the drain's deviation; its drain is 1.3 of the nominal."""
    mean, cov = state(0.9, 0.8)
    mean[DRAIN] = 1.3
    cov = np.pad(cov, (0, 1))
    cov[SWING, SWING] = variance
    return np.append(mean, swing), cov


HOURS = st.floats(0.01, 72)


@given(first_h=HOURS, second_h=HOURS, swing=st.floats(-0.2, 0.2), variance=st.floats(0, 0.01))
def test_two_intervals_of_a_swinging_drain_are_one(
    first_h: float, second_h: float, swing: float, variance: float
) -> None:
    """A steady load of 0.01 an hour, with a swing of 0.06 that lasts: a Markov process does not mind a look at it."""
    parameters = told_of_a_swing(0.06)

    def after(state: tuple[charge.Array, charge.Array], hours: float) -> tuple[charge.Array, charge.Array]:
        elapsed_ms = round(hours * 3_600_000)
        swing, noise = charge.swing_over(parameters, elapsed_ms), charge.process_noise(parameters, elapsed_ms)
        noise[DRAIN, DRAIN] = 0  # its ageing is another process
        return charge.discharged(
            *state, Spent(1.0, 0.01 * elapsed_ms / 3_600_000, 0.0), (0.0, 0.0), noise, swing
        )

    begin, rows = swinging(swing, variance), [PRIMARY, SWING]
    twice, once = after(after(begin, first_h), second_h), after(begin, first_h + second_h)
    assert twice[0][rows] == pytest.approx(once[0][rows], abs=1e-8)
    assert twice[1][np.ix_(rows, rows)] == pytest.approx(once[1][np.ix_(rows, rows)], abs=1e-8)


def test_the_swing_of_a_drain_is_the_simulated_one() -> None:
    """10,000 drains that begin 0.1 too high, in steps of six minutes, over nine hours: 0.01 an hour times 1.3."""
    luck, hours, step_h, lasts_h = np.random.default_rng(3), 9.0, 0.1, 6.0
    keeps = np.exp(-step_h / lasts_h)
    x, spent = np.full(10_000, 0.1), np.zeros(10_000)
    for _ in range(round(hours / step_h)):
        before = x
        x = keeps * x + 0.06 * np.sqrt(1 - keeps**2) * luck.standard_normal(len(x))
        spent += 0.013 * step_h * (1 + (before + x) / 2)
    parameters, elapsed_ms = told_of_a_swing(0.06), round(hours * 3_600_000)
    swing, noise = charge.swing_over(parameters, elapsed_ms), charge.process_noise(parameters, elapsed_ms)
    noise[DRAIN, DRAIN] = 0
    mean, cov = charge.discharged(*swinging(0.1, 0.0), Spent(1.0, 0.09, 0.0), (0.0, 0.0), noise, swing)
    assert mean[[PRIMARY, SWING]] == pytest.approx([0.9 - spent.mean(), x.mean()], abs=2e-3)
    assert cov[np.ix_([PRIMARY, SWING], [PRIMARY, SWING])] == pytest.approx(np.cov(-spent, x), rel=0.06)
    # Between packets the belief says the same.
    drain, variance, _ = charge.drain_over(*swinging(0.1, 0.0), swing)
    assert 0.09 * drain == pytest.approx(spent.mean(), abs=3e-4)
    assert 0.09**2 * variance == pytest.approx(spent.var(), rel=0.06)


def test_a_reading_below_the_expected_tells_of_the_swing() -> None:
    """A reading 0.03 lower than expected, noise 0.01, after the swing alone made the charge uncertain."""
    parameters = told_of_a_swing(0.06)
    begin = swinging(0.0, 0.06**2)
    swing = charge.swing_over(parameters, 0)
    mean, cov = charge.discharged(*begin, Spent(1.0, 0.2, 0.0), (0.0, 0.0), np.zeros_like(begin[1]), swing)
    found, _, _, _ = charge.measured(mean, cov, SENSOR, Mode.ASLEEP, (0.9 - 0.26 - 0.03, 0.8))
    # The swing makes the charge uncertain by 0.2 * 1.3 * 0.06 = 0.0156.
    assert found[SWING] == pytest.approx(0.03 * 0.0156 * 0.06 / (0.0156**2 + 1e-4))
    assert charge.swing_over(told_of_a_swing(0.0), 1000) is None
    assert len(charge.prior_state(told_of_a_swing(0.0))[0]) == SIZE


BENT = replace(SENSOR, curve=VoltageCurve(((0, 0), (6 * FULL // 10, 3 * FULL // 10), (FULL, FULL))))


@pytest.mark.parametrize(
    ("uncertain", "sensor", "mode", "readings", "expected", "left"),
    [
        # Both charges are certain, so 0.03 too much in both readings is lift: two readings are worth one of half the noise,
        # 0.03 * 1e-4 / (1e-4 + 0.5e-4).
        pytest.param(
            {"charging": 1e-4},
            SENSOR,
            Mode.CHARGING_PRIMARY,
            (0.53, 0.63),
            {CHARGING: 0.02, PRIMARY: 0.5, SECONDARY: 0.6},
            {CHARGING: 1 / (1 / 1e-4 + 2 / 1e-4)},
            id="a charger lifts what both batteries read",
        ),
        pytest.param(
            {"asleep": 1e-4},
            SENSOR,
            Mode.ASLEEP,
            (0.48, 0.63),
            {ASLEEP: -0.01, SECONDARY: 0.6},
            {},
            id="a load moves the primary's reading alone",
        ),
        # On the flat piece a charge of 0.5 reads 0.25, and 0.01 of voltage is 0.02 of charge. A prior of 0.02 and a reading
        # of 0.01 * 2 meet in the middle; a bias of the voltage counts twice, too.
        pytest.param(
            {"primary": 4e-4},
            BENT,
            Mode.ASLEEP,
            (0.27, 0.3),
            {PRIMARY: 0.52},
            {PRIMARY: 2e-4},
            id="along a curve",
        ),
        pytest.param(
            {"asleep": 1e-4}, BENT, Mode.ASLEEP, (0.27, 0.3), {ASLEEP: 0.01}, {}, id="its errors, too"
        ),
    ],
)
def test_a_reading_by_hand(
    uncertain: dict[str, float],
    sensor: SensorParameters,
    mode: Mode,
    readings: tuple[float, float],
    expected: dict[int, float],
    left: dict[int, float],
) -> None:
    """Of charges of 0.5 and 0.6, certain but for what is named."""
    found, cov, _, surprise = charge.measured(*state(0.5, 0.6, **uncertain), sensor, mode, readings)
    assert {row: found[row] for row in expected} == pytest.approx(expected)
    assert {row: cov[row, row] for row in left} == pytest.approx(left)
    assert PRIMARY not in left or surprise == pytest.approx(0.04 / sqrt(8e-4))


@pytest.mark.parametrize(("together", "variance"), [(3e-4, 1.5e-3), (-3e-4, 3e-4)])
def test_a_charge_and_a_bias_that_go_together_surprise_less(together: float, variance: float) -> None:
    """The variance of the sum: 4e-4 + 4e-4 + 1e-4 of noise, and twice the covariance; the secondary's is 3e-4 + 1e-4."""
    mean, cov = state(0.5, 0.6, primary=4e-4, secondary=3e-4, asleep=4e-4)
    cov[PRIMARY, ASLEEP] = cov[ASLEEP, PRIMARY] = together
    _, _, density, surprise = charge.measured(mean, cov, SENSOR, Mode.ASLEEP, (0.56, 0.64))
    assert surprise == pytest.approx(0.06 / sqrt(variance))
    expected = 0.06**2 / variance + np.log(variance) + 0.04**2 / 4e-4 + np.log(4e-4)
    assert density == pytest.approx(-0.5 * expected)


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
    """Random walks: after four days the deviation is twice that of one day. A bias wanders by 15 % of 0.02,
    and a sensor's constant one by 2 % of 0.05."""
    parameters = replace(flight_config(load(SOUND_FILE)).twin.parameters, ageing_per_day=0.002)
    for days, deviation in ((1, 0.002), (4, 0.004)):
        noise = charge.process_noise(parameters, days * 86_400_000)
        its = np.sqrt(noise.diagonal()[[DRAIN, ASLEEP, CHARGING, BIAS]])
        assert its == pytest.approx([deviation, 0.003 * sqrt(days), 0.003 * sqrt(days), 0.001 * sqrt(days)])
        assert np.count_nonzero(noise) == 7


def test_a_twin_that_is_told_nothing_begins_with_the_moments_of_uniform_ranges() -> None:
    """Capacities of 0.6 to 1 and loads of 0.8 to 1.2, against a million draws of both."""
    mean, cov = charge.prior_state(replace(told_of_a_swing(0.0), drain_deviation=0.0))
    luck = np.random.default_rng(1)
    rate = 1 / luck.uniform(0.6, 1.0, 1_000_000)
    drain = luck.uniform(0.8, 1.2, 1_000_000) * rate
    assert mean[[DRAIN, RATE]] == pytest.approx([drain.mean(), rate.mean()], rel=2e-3)
    assert cov[np.ix_([DRAIN, RATE], [DRAIN, RATE])] == pytest.approx(np.cov(drain, rate), rel=1e-2)
    assert sqrt(cov[BIAS, BIAS]) == pytest.approx(0.05 / sqrt(3))


def test_a_battery_may_have_reached_the_end_and_then_its_reading_is_the_sensors_bias() -> None:
    """Charge and bias are known by their sum, 0.98, alone: predicted 0.02 higher, half of it is full.

    The full half has a bias of -0.02 less half a Gaussian's mean, 0.04 * sqrt(2 / pi), beyond the end.
    """
    mean, cov = state(1.0, 0.5, primary=16e-4, sensor=16e-4)
    mean[BIAS] = -0.02
    cov[PRIMARY, BIAS] = cov[BIAS, PRIMARY] = -16e-4
    within, full = charge.split_at_ends(charge.Anchor(1.0, mean, cov))
    assert (within.weight, full.weight) == pytest.approx((0.5, 0.5))
    half = 0.04 * sqrt(2 / np.pi)
    assert full.mean[[PRIMARY, BIAS]] == pytest.approx([1.0, -0.02 - half])
    assert within.mean[[PRIMARY, BIAS]] == pytest.approx([1 - half, -0.02 + half])
    assert full.cov[PRIMARY, PRIMARY] == 0 and full.cov[BIAS, BIAS] == pytest.approx(16e-4 * (1 - 2 / np.pi))
    # A reading of 0.95 then is a bias of nearly -0.05, and no battery that is not full.
    bias, _, _, _ = charge.measured(full.mean, full.cov, SENSOR, Mode.CHARGING_PRIMARY, (0.95, 0.5))
    assert bias[PRIMARY] == 1 and bias[BIAS] == pytest.approx(-0.05, abs=0.001)


def test_a_battery_is_split_by_what_lies_beyond_its_ends_and_far_from_both_not_at_all() -> None:
    """0.5 +- 0.5: beyond each end lies what a Gaussian has beyond a deviation."""
    row = charge.Anchor(0.7, *state(0.5, 0.6, primary=1e-4, secondary=1e-4, sensor=1e-3))
    assert charge.split_at_ends(row) == [row]
    parts = charge.split_at_ends(charge.Anchor(1.0, *state(0.5, 0.6, primary=0.25)))
    assert [it.weight for it in parts] == pytest.approx([0.6827, 0.1587, 0.1587], abs=1e-4)
