"""The sensors against calculations by hand: counts, ranges, noise, and conversion between counts and values."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_model.power.rails import RAILS, SENSOR_RAILS, bits
from firmware_model.sampling.sensor import MAX_COUNT, Sensor
from firmware_model.sampling.sensors import SENSORS, sample, values
from firmware_model.states import State

LINEAR = Sensor("linear", "m", (-10.0, 0.5), low=-5.0, high=100.0, noise=2.0, calm=None, load_mw=0)
QUIET = (0.0, 0.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ("true", "noise", "count", "outside"),
    [
        pytest.param(7.0, 0.0, 34, False, id="(7 + 10) / 0.5"),
        pytest.param(7.0, 1.5, 40, False, id="three more by its noise"),
        pytest.param(7.2, 0.0, 34, False, id="the nearer of 7 and 7.5"),
        pytest.param(7.25, 0.0, 34, False, id="the lower of two as near"),
        *(pytest.param(it, 0.0, 220, it > 100, id=f"{it}, at or beyond its end") for it in (100.0, 100.1)),
        *(pytest.param(it, 0.0, 10, it < -5, id=f"{it}, at or beyond its begin") for it in (-5.0, -5.1)),
        pytest.param(99.0, 1.0, 220, True, id="its noise took it beyond its end"),
    ],
)
def test_a_reading_by_hand(true: float, noise: float, count: int, outside: bool) -> None:
    assert LINEAR.read(true, noise) == (count, outside)


def test_coefficients_go_from_the_constant_on() -> None:
    squared = Sensor("squared", "m", (1.0, 2.0, 3.0), low=1.0, high=6.0, noise=0.0, calm=None, load_mw=0)
    assert (squared.value(10), LINEAR.value(34)) == (1 + 20 + 300, 7.0)


@pytest.mark.parametrize(
    ("low", "high", "noise"), [(-11.0, 5.0, 0.0), (0.0, 1e9, 0.0), (5.0, 5.0, 0.0), (0.0, 5.0, -1.0)]
)
def test_a_sensor_that_cannot_be_is_refused(low: float, high: float, noise: float) -> None:
    with pytest.raises(ValueError):
        Sensor("linear", "m", (-10.0, 0.5), low, high, noise, None, 0)


def test_the_calibrations_as_printed() -> None:
    oxygen, pressure, temperature, turbidity = SENSORS
    assert oxygen.value(40_000) == pytest.approx(2.4e-4 * 40_000 + 1.2e-9 * 1.6e9)  # 11.52 mg/l
    assert pressure.read(1013.25 + 100.518 * 3, 0.0) == (8148, False)  # 1314.8 mbar, 3 m deep
    assert temperature.read(21.5, 0.0) == (31_500, False)
    assert turbidity.value(10_000) == pytest.approx(126.0)


@pytest.mark.parametrize("sensor", SENSORS, ids=lambda it: it.key)
@given(st.integers(0, MAX_COUNT))
def test_a_count_stands_for_a_value_that_reads_as_that_count(sensor: Sensor, count: int) -> None:
    assert sensor.count(sensor.value(count)) == count


@pytest.mark.parametrize("sensor", SENSORS, ids=lambda it: it.key)
@given(st.floats(0, 1))
def test_a_reading_is_within_half_a_step_of_what_is_true(sensor: Sensor, place: float) -> None:
    true = sensor.low + place * (sensor.high - sensor.low)
    count, outside = sensor.read(true, 0.0)
    step = sensor.value(min(MAX_COUNT, count + 1)) - sensor.value(max(0, count - 1))
    assert not outside
    assert abs(sensor.value(count) - true) <= step / 2 * (1 + 1e-6)


def test_a_sample_of_all_four_and_what_it_stands_for() -> None:
    counts, saturated = sample(SENSORS, (8.0, 1314.8, 21.5, 5000.0), QUIET)
    assert counts[1:3] == (8148, 31_500)
    assert saturated == 0b1000
    assert values(SENSORS, counts) == pytest.approx((8.0, 1314.8, 21.5, 1000.0), abs=0.01)
    assert sample(SENSORS, (8.0, 0.0, 99.0, 5.0), QUIET)[1] == 0b0110


def test_every_sensor_has_a_rail_of_its_own_that_is_on_while_the_board_samples() -> None:
    assert [rail.name.lower() for rail in SENSOR_RAILS] == [sensor.name for sensor in SENSORS]
    assert RAILS[State.SAMPLING] & bits(*SENSOR_RAILS) == bits(*SENSOR_RAILS)
