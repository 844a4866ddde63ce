"""The water's true values, and the noise of the sensors."""

from statistics import fmean, pstdev

import pytest

from agents.water.fields import Constant, WaterFields, unit_noises

WATER = WaterFields.by_key(
    {"oxygen_mg_l": Constant(8.0), "temperature_c": Constant(21.5), "turbidity_ntu": Constant(4.0)}
)


def test_pressure_is_that_of_the_column_above() -> None:
    assert WATER.values_at(1, 2, 0, 3) == (8.0, 1013.25, 21.5, 4.0)
    # 10 m of sea water: 1025 kg/m3 * 9.80665 m/s2 * 10 m = 100 518 Pa
    assert WATER.values_at(0, 0, 10_000_000, 0)[1] == pytest.approx(1013.25 + 1005.18, abs=0.01)


def test_noise_has_mean_0_and_variance_1_and_no_correlation() -> None:
    drawn = [unit_noises(7, agent_id, n) for agent_id in range(1, 11) for n in range(500)]
    for of_one in zip(*drawn, strict=True):
        # The standard error of 5000 draws' mean is 0.014, of their deviation 0.010: five times that.
        assert abs(fmean(of_one)) < 0.07
        assert abs(pstdev(of_one) - 1) < 0.05
        assert max(map(abs, of_one)) < 4.9
    for one in range(4):
        for other in range(one):
            assert abs(fmean(noises[one] * noises[other] for noises in drawn)) < 0.07


def test_noise_is_keyed_and_nothing_else() -> None:
    assert unit_noises(7, 1, 2) == unit_noises(7, 1, 2)
    others = {unit_noises(7, 1, 2), unit_noises(8, 1, 2), unit_noises(7, 2, 2), unit_noises(7, 1, 3)}
    assert len(others) == 4
