"""The closed forms against the paper's own difference equations, Table I, and an iteration millisecond by millisecond."""

from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_model.power.charge import (
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


def anywhere(most: int) -> st.SearchStrategy[int]:
    """On all of a scale: of a large range of whole numbers Hypothesis draws the small ones."""
    return st.builds(
        lambda share, more: min(most, share * most // 1000 + more), st.integers(0, 1000), st.integers(0, 1000)
    )


charges = anywhere(FULL)
flows = st.sampled_from(Flow)


def iterated(model: ChargeModel, battery: Battery, steps: int) -> int:
    """Equations (1) and (2) stepped once a millisecond, as the paper writes them, with a load beside the charger."""
    curve = model.segments_by_two if battery.coils == 2 else model.segments

    def segment(charge: int) -> tuple[int, int]:
        return next((end, rate - battery.load) for end, rate in curve if charge <= end)

    charge = battery.charge
    for _ in range(steps):
        if battery.flow is Flow.DISCHARGING:
            charge -= model.discharge + battery.load
        elif battery.flow is Flow.CHARGING:
            end, net = segment(charge)
            charge = min(FULL, max(0, charge + net))
            # The charge does not rise into a segment in which it would not go on rising.
            if net > 0 and charge > end and segment(charge)[1] <= 0:
                charge = end
        charge = min(FULL, max(0, charge))
    return charge


# Loads among the rates of the curves below, so that some segments rise and others fall.
loads = st.one_of(st.just(0), anywhere(FULL // 60))
# Rates that do not only rise, of a charger that tapers off, and so high that a few milliseconds cross every breakpoint.
TAPERED = ChargeModel(
    FULL // 700,
    ((FULL // 5, FULL // 300), (FULL // 2, FULL // 77), (FULL, FULL // 200)),
    ((FULL // 3, FULL // 90), (FULL // 2, FULL // 100), (FULL, FULL // 70)),
)
batteries = st.builds(Battery, st.just(1000), charges, flows, loads, st.sampled_from([1, 2]))


@given(batteries, st.integers(0, 400))
def test_closed_form_is_the_iteration(battery: Battery, elapsed_ms: int) -> None:
    assert TAPERED.charge_at(battery, 1000 + elapsed_ms) == iterated(TAPERED, battery, elapsed_ms)


@pytest.mark.parametrize(
    ("model", "coils", "span_ms"), [(TAPERED, 1, 700), (TAPERED, 2, 700), (PAPER, 1, 10**8)]
)
@given(batteries, st.lists(st.floats(0, 1), max_size=6))
def test_cutting_time_does_not_show(
    model: ChargeModel, coils: int, span_ms: int, battery: Battery, shares: list[float]
) -> None:
    whole = cut = replace(battery, coils=coils)
    for share in sorted(shares):
        cut = model.settle(cut, 1000 + int(share * span_ms), cut.flow, cut.load)
    assert model.charge_at(cut, 1000 + span_ms) == model.charge_at(whole, 1000 + span_ms)


@given(batteries, charges)
def test_falls_to_and_reaches_are_the_first_milliseconds_that_do(battery: Battery, target: int) -> None:
    course = [TAPERED.charge_at(battery, 1000 + ms) for ms in range(700)]
    for found_ms, there in (
        (TAPERED.falls_to_at_ms(battery, target), [charge <= target for charge in course]),
        (TAPERED.reaches_at_ms(battery, target), [charge >= target for charge in course]),
    ):
        first = 1000 + there.index(True) if any(there) else None
        assert found_ms == first or (first is None and found_ms is not None and found_ms >= 1700)


def test_a_load_above_the_charger_s_upper_rate_holds_the_charge_at_the_breakpoint() -> None:
    # 1/77 a millisecond up to one half, and then 1/200 less a load of 1/100: it neither rises nor falls there.
    begins = (Battery(0, it, Flow.CHARGING, FULL // 100) for it in (FULL // 4, FULL))
    assert [TAPERED.charge_at(it, 10_000) for it in begins] == [FULL // 2] * 2


@given(charges, charges, loads)
def test_over_hours_too_they_are_the_first_milliseconds(charge: int, target: int, load: int) -> None:
    falls, rises = Battery(0, charge, Flow.DISCHARGING, load), Battery(0, charge, Flow.CHARGING)
    for battery, at_ms, least, most in (
        (falls, PAPER.empty_at_ms(falls), 0, 0),
        (rises, PAPER.reaches_at_ms(rises, target), target, FULL),
    ):
        assert at_ms is not None and least <= PAPER.charge_at(battery, at_ms) <= most
        assert at_ms == 0 or not least <= PAPER.charge_at(battery, at_ms - 1) <= most


@pytest.mark.parametrize(
    ("found_ms", "minutes"),
    [
        pytest.param(PAPER.empty_at_ms(Battery(0, FULL, Flow.DISCHARGING)), it, id=f"a full discharge, {by}")
        for it, by in (
            (pytest.approx(962, rel=0.005), "Table I"),
            (pytest.approx(1 / 0.0010427134, abs=0.001), "equation (1)"),
        )
    ]
    + [
        # By hand: 0.16197/0.001045 + (0.5634 - 0.16197)/0.00223 + (1 - 0.5634)/0.002911 = 155.00 + 180.01 + 149.98 min.
        pytest.param(
            PAPER.reaches_at_ms(Battery(0, 0, Flow.CHARGING), FULL),
            pytest.approx(484.99, abs=0.02),
            id="a full charge, Table I's 485 minutes",
        ),
        pytest.param(PAPER.reaches_at_ms(Battery(0, 10, Flow.RESTING), 11), None, id="at rest nothing comes"),
        pytest.param(PAPER.reaches_at_ms(Battery(0, 10, Flow.DISCHARGING), 11), None, id="nor in the water"),
        pytest.param(PAPER.empty_at_ms(Battery(0, 10, Flow.CHARGING)), None, id="nothing empties in a dock"),
    ],
)
def test_how_long_it_takes(found_ms: int | None, minutes: float | None) -> None:
    assert (None if found_ms is None else found_ms / 60_000) == minutes


@pytest.mark.parametrize("rate", [0.0, -0.001, 0.00000000001])
def test_a_rate_that_is_no_whole_number_of_grains_is_refused(rate: float) -> None:
    with pytest.raises(ValueError, match="10 decimals"):
        grains_per_ms(rate)


def test_scales() -> None:
    assert grains(0.5634) == 338_040_000_000_000
    assert fraction(grains(0.25)) == 0.25
    assert (millivolts(0), millivolts(FULL // 2), millivolts(FULL)) == (3600, 3900, 4200)
