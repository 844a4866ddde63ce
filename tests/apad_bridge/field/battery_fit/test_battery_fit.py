"""Tests the fit on logs made by equations (1) and (2), step by step."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from apad_bridge.field.battery_fit.battery_fit import BatteryFit, Direction, along, fit_log, minutes_to_full
from apad_bridge.field.battery_fit.battery_log import BatteryLog, Floats, LogError

EQUATION_2 = ((0.16197, 0.001045), (0.5634, 0.00223), (1.0, 0.002911))


def charged(
    rates: tuple[tuple[float, float], ...], step_min: float, noise: float = 0.0, seed: int = 0
) -> Floats:
    """A log by the paper's difference equation, a row a step, until it is clamped at 1."""
    u, rows = 0.0, [0.0]
    while u < 1:
        u += step_min * next(rate for end, rate in rates if u <= end)
        rows.append(min(u, 1.0))
    return np.array(rows) + np.random.default_rng(seed).normal(0, noise, len(rows))


def log(scaled: Floats, step_min: float = 1.0, name: str = "a.csv") -> BatteryLog:
    return BatteryLog(name, np.arange(len(scaled)) * step_min, scaled, 0)


def at(fitted: BatteryFit) -> list[float]:
    return [number for segment in fitted.charge_segments for number in segment]


MINUTES = np.arange(100.0)
BENT = 0.3 + 0.002 * MINUTES + 0.003 * np.maximum(0, MINUTES - 50)
CURVE = charged(EQUATION_2, 1.0)
KEPT = np.concatenate((np.arange(0, 90), np.arange(140, len(CURVE))))


@pytest.mark.parametrize(
    ("given_log", "segments", "expected", "rel", "also"),
    [
        pytest.param(
            log(charged(EQUATION_2, 1 / 60), 1 / 60),
            None,
            [it for row in EQUATION_2 for it in row],
            2e-3,
            {"direction": Direction.CHARGING, "rmse": pytest.approx(0, abs=1e-4)},
            id="the paper's charging curve",
        ),
        pytest.param(log(BENT), 2, [0.4, 0.002, 1.0, 0.005], 1e-3, {}, id="a log that stops short"),
        pytest.param(
            BatteryLog("a.csv", KEPT.astype(float), CURVE[KEPT], 7),
            None,
            [it for row in EQUATION_2 for it in row],
            0.02,
            {"gaps": ((89.0, 140.0),), "left_out": 7},
            id="gaps are told and fitted across",
        ),
    ],
)
def test_a_charge_is_found_in_a_log_of_it(
    given_log: BatteryLog, segments: int | None, expected: list[float], rel: float, also: dict[str, Any]
) -> None:
    fitted = fit_log(given_log, segments)
    assert at(fitted) == pytest.approx(expected, rel=rel)
    assert {name: getattr(fitted, name) for name in also} == also


def test_the_paper_s_curve_fills_in_the_paper_s_time() -> None:
    assert minutes_to_full(EQUATION_2) == pytest.approx(485, abs=1)


def test_the_paper_s_discharging_rate_is_found_in_a_noisy_log_of_it() -> None:
    noise = np.random.default_rng(5).normal(0, 0.01, 960)
    fitted = fit_log(log(1 - 0.0010427134 * np.arange(960.0) + noise))
    assert fitted.direction is Direction.DISCHARGING
    assert fitted.discharge_per_min == pytest.approx(0.0010427134, rel=0.005)
    assert fitted.rmse == pytest.approx(0.01, rel=0.1)


@settings(deadline=None, max_examples=25)
@given(
    st.lists(st.floats(0.15, 0.4), min_size=1, max_size=4),
    st.floats(0.001, 0.002),
    st.lists(st.floats(1.7, 2.5), min_size=3, max_size=3),
    st.integers(0, 2**31),
)
def test_known_segments_come_out_of_a_noisy_log(
    widths: list[float], first: float, steeper: list[float], seed: int
) -> None:
    ends = [float(end) for end in np.cumsum(widths) / sum(widths)]
    ends[-1] = 1.0
    rates = [first * float(factor) for factor in np.cumprod([1.0, *steeper])]
    known = tuple(zip(ends, rates, strict=False))
    step_min = minutes_to_full(known) / 3000
    fitted = fit_log(log(charged(known, step_min, 0.003, seed), step_min), len(known))
    for (end, rate), (known_end, known_rate) in zip(fitted.charge_segments, known, strict=True):
        assert end == pytest.approx(known_end, abs=0.03)
        assert rate == pytest.approx(known_rate, rel=0.06)


def test_a_charge_along_a_discharge_s_curve_has_the_rates_of_its_charge() -> None:
    """The voltage of a constant current bends along the curve, and lies higher on a charger; the charge does not bend."""
    charges, voltages = [0.0, 0.2, 0.6, 1.0], [0.0, 0.3, 0.5, 1.0]
    falling = np.interp(1 - np.arange(961) / 960, charges, voltages)
    discharge = fit_log(log(falling), 3)
    for point, expected in zip(discharge.discharge_curve, zip(charges, voltages, strict=True), strict=True):
        assert point == pytest.approx(expected, abs=0.005)
    rising = np.minimum(1.0, np.interp(np.arange(480) / 480, charges, voltages) + 0.05)
    charge = fit_log(along(log(rising), discharge, 0.05), 1)
    assert at(charge) == pytest.approx([1.0, 1 / 480], rel=0.01)


def test_rests_before_and_after_are_no_part_of_the_charge() -> None:
    rested = np.concatenate((np.full(60, -0.01), CURVE, np.full(200, 1.0)))
    fitted = fit_log(log(rested))
    assert fitted.outside == pytest.approx(260, abs=2)
    assert at(fitted) == pytest.approx(at(fit_log(log(CURVE))), rel=0.02)
    falling = fit_log(log(1 - rested), 3)
    assert falling.direction is Direction.DISCHARGING
    assert [piece.per_min for piece in falling.segments] == pytest.approx(
        [-piece.per_min for piece in fitted.segments], rel=1e-3
    )


def test_residuals_are_those_of_each_segment() -> None:
    scaled = 0.005 * MINUTES + 0.005 * np.maximum(0, MINUTES - 60)
    scaled[60:] += np.where(np.arange(40) % 2, 0.01, -0.01)
    fitted = fit_log(log(np.clip(scaled, None, 0.99)), 2)
    quiet, loud = fitted.segments
    assert quiet.rmse < 0.002
    assert loud.rmse == pytest.approx(0.01, rel=0.1)
    assert fitted.max_abs == max(quiet.max_abs, loud.max_abs) == pytest.approx(0.01, rel=0.3)
    assert (quiet.rows + loud.rows, loud.rows) == (100, pytest.approx(40, abs=2))


@pytest.mark.parametrize(
    ("scaled", "segments", "direction", "message"),
    [
        (np.array([0.1, 0.2, 0.3]), None, None, "3 rows are too few"),
        (np.linspace(0.1, 0.9, 9), 3, None, "of 9 rows 9 lie on the scale; 9 rows are too few for 3 segments: 10"),
        (np.full(50, 0.7), None, None, "neither rises nor falls"),
        (np.concatenate((np.linspace(0.1, 0.9, 50), np.linspace(0.9, 0.5, 20))), 2, None, "segment 2 of 2, .*wrong way"),
        (np.linspace(0.9, 0.1, 50), 1, Direction.CHARGING, "goes the wrong way for charging"),
        (np.linspace(1.5, 1.2, 50), 1, None, "lie on the scale"),
    ],
)  # fmt: skip
def test_what_a_log_lacks_is_one_line(
    scaled: Floats, segments: int | None, direction: Direction | None, message: str
) -> None:
    with pytest.raises(LogError, match=message):
        fit_log(log(scaled), segments, direction)
