"""The closed forms against the paper's own difference equations, Table I, and an iteration millisecond by millisecond."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_model.charge import (
    FULL,
    Battery,
    ChargeModel,
    Flow,
    fraction,
    grains,
    grains_per_ms,
    millivolts,
)

PAPER = ChargeModel.from_minutes(0.0010427134, ((0.16197, 0.001045), (0.5634, 0.00223), (1.0, 0.002911)))
# Rates so high that a few milliseconds cross every breakpoint: the iteration below stays short.
STEEP = ChargeModel(FULL // 700, ((FULL // 5, FULL // 300), (FULL // 2, FULL // 111), (FULL, FULL // 77)))

charges = st.integers(0, FULL)
flows = st.sampled_from(Flow)


def iterated(model: ChargeModel, charge: int, flow: Flow, steps: int) -> int:
    """Equations (1) and (2) stepped once a millisecond, as the paper writes them."""
    for _ in range(steps):
        if flow is Flow.DISCHARGING:
            charge -= model.discharge
        elif flow is Flow.CHARGING:
            charge += next(rate for end, rate in model.segments if charge <= end)
        charge = min(FULL, max(0, charge))
    return charge


@given(charges, flows, st.integers(0, 400))
def test_closed_form_is_the_iteration(charge: int, flow: Flow, elapsed_ms: int) -> None:
    battery = Battery(1000, charge, flow)
    assert STEEP.charge_at(battery, 1000 + elapsed_ms) == iterated(STEEP, charge, flow, elapsed_ms)


@given(charges, flows, st.lists(st.integers(0, 10**8), max_size=6))
def test_cutting_time_does_not_show(charge: int, flow: Flow, cuts: list[int]) -> None:
    whole = Battery(0, charge, flow)
    cut = whole
    for at_ms in sorted(cuts):
        cut = PAPER.settle(cut, at_ms, flow)
    end_ms = max(cuts, default=0) + 12345
    assert PAPER.charge_at(cut, end_ms) == PAPER.charge_at(whole, end_ms)


@given(charges)
def test_empty_at_is_the_first_empty_millisecond(charge: int) -> None:
    battery = Battery(0, charge, Flow.DISCHARGING)
    empty_ms = PAPER.empty_at_ms(battery)
    assert empty_ms is not None
    assert PAPER.charge_at(battery, empty_ms) == 0
    assert empty_ms == 0 or PAPER.charge_at(battery, empty_ms - 1) > 0


@given(charges, charges)
def test_reaches_at_is_the_first_millisecond_with_the_target(charge: int, target: int) -> None:
    battery = Battery(0, charge, Flow.CHARGING)
    at_ms = PAPER.reaches_at_ms(battery, target)
    assert at_ms is not None
    assert PAPER.charge_at(battery, at_ms) >= target
    assert at_ms == 0 or PAPER.charge_at(battery, at_ms - 1) < target


def test_full_discharge_takes_table_i_s_962_minutes_within_half_a_percent() -> None:
    empty_ms = PAPER.empty_at_ms(Battery(0, FULL, Flow.DISCHARGING))
    assert empty_ms is not None
    assert empty_ms / 60_000 == pytest.approx(962, rel=0.005)
    assert empty_ms / 60_000 == pytest.approx(1 / 0.0010427134, abs=0.001)


def test_full_charge_takes_table_i_s_485_minutes() -> None:
    # By hand: 0.16197/0.001045 + (0.5634 - 0.16197)/0.00223 + (1 - 0.5634)/0.002911 = 155.00 + 180.01 + 149.98 min.
    full_ms = PAPER.reaches_at_ms(Battery(0, 0, Flow.CHARGING), FULL)
    assert full_ms is not None
    assert full_ms / 60_000 == pytest.approx(484.99, abs=0.02)


def test_resting_and_discharging_batteries_never_reach_more() -> None:
    assert PAPER.reaches_at_ms(Battery(0, 10, Flow.RESTING), 11) is None
    assert PAPER.reaches_at_ms(Battery(0, 10, Flow.DISCHARGING), 11) is None
    assert PAPER.empty_at_ms(Battery(0, 10, Flow.CHARGING)) is None


def test_time_going_back_is_refused() -> None:
    with pytest.raises(ValueError, match="time went back"):
        PAPER.charge_at(Battery(10, 0, Flow.RESTING), 9)


@pytest.mark.parametrize("rate", [0.0, -0.001, 0.00000000001])
def test_a_rate_that_is_no_whole_number_of_grains_is_refused(rate: float) -> None:
    with pytest.raises(ValueError, match="10 decimals"):
        grains_per_ms(rate)


def test_scales() -> None:
    assert grains(0.5634) == 338_040_000_000_000
    assert fraction(grains(0.25)) == 0.25
    assert (millivolts(0), millivolts(FULL // 2), millivolts(FULL)) == (3600, 3900, 4200)
