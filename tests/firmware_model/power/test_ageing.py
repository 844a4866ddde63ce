"""Boards on batteries that years and cycles have aged."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import pytest

from firmware_model.bench import Bench
from firmware_model.config import BoardConfig
from firmware_model.power.ageing import AS_NEW, Fading, aged, capacity_left
from firmware_model.power.charge import FULL, ChargeModel, grains
from firmware_model.table_one import METERING, board, power


def test_cycles_and_years_take_their_parts() -> None:
    # 500 cycles at 4 % a hundred take 20 %, two years at 3 % another 6 %.
    assert capacity_left(500, 2) == 7400
    assert capacity_left(0, 0) == AS_NEW
    assert capacity_left(100, 0.5, Fading(per_100_cycles=1000, per_year=100)) == 8950


@pytest.mark.parametrize(
    ("refused", "why"),
    [
        *(
            (partial(capacity_left, *it), r"age|nothing is left")
            for it in ((-1, 0), (0, -0.1), (10_000, 0), (0, 40))
        ),
        *((partial(aged, board(None, power()), it), "capacity") for it in (0, AS_NEW + 1)),
    ],
)
def test_an_age_or_a_capacity_that_cannot_be_is_refused(refused: Callable[[], object], why: str) -> None:
    with pytest.raises(ValueError, match=why):
        refused()


def test_what_it_lasts_and_what_it_takes_to_charge_shrink_alike() -> None:
    config = aged(board(None, power()), 8000)
    bench = Bench(config)
    bench.run(minutes=500)
    # Equation (1) is an idle board on a new battery: here 500 min at 1.25 times that, to the millisecond of its boot.
    assert bench.primary_fraction == pytest.approx(1 - 500 * 0.0010427134 / 0.8, abs=1e-6)
    docked = Bench(aged(board(None, power(), agent_id=2), 8000), secondary=0.0, docked=True)
    full_ms = docked.config.charge.reaches_at_ms(docked.board.secondary, FULL)
    # Table I's 485 min, that is equation (2)'s three segments: 0.16197 / 0.001045 + 0.40143 / 0.00223 + 0.4366 / 0.002911.
    assert full_ms is not None and full_ms / 60_000 == pytest.approx(0.8 * 484.99, abs=0.1)


def test_the_paper_s_worst_case_ages_too_and_as_new_nothing_changes() -> None:
    new, half = (ChargeModel.from_minutes(0.001 * n, ((1.0, 0.002 * n),)) for n in (1, 2))
    assert aged(BoardConfig(1, new, 50, 2000, 600_000, 120_000), 5000).charge == half
    config = board(None, power(metering=METERING))
    assert aged(config, AS_NEW) == config


def test_the_same_current_pulls_the_voltage_down_as_far_as_ever() -> None:
    # Pi on: of a battery as new, 1000 mW sag 0.1 ohm * 270 mA = 27 mV = 0.045 of the scale, idle's own 1.2 mV taken off.
    for capacity in (AS_NEW, 6000):
        bench = Bench(aged(board(None, power(kept_on=1 << 6, metering=replace(METERING, noise=0))), capacity))
        bench.run(minutes=1)
        reading, _ = bench.board.readings(bench.now_ms)
        assert bench.primary - reading == pytest.approx(grains(0.045), rel=0.01)
