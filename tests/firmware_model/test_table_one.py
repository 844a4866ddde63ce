"""Runs the paper's Table I on a board; checks that the model has fewer free numbers than the table has rows."""

import pytest

from firmware_model.bench.table_one_runs import ROWS, Row, rows
from firmware_model.power.charge import FULL
from firmware_model.power.rails import IDLE, Rail
from firmware_model.table_one import ASSUMED, FITTED, LOADS, METERED, METERING, MODEL, TAKEN

# Printed in the paper, section IV-A; "within 3 hours" for the heavy run.
PAPER_MIN = [962, 14057, 575, 398, 485, 180]


@pytest.mark.parametrize("row", [*ROWS, *rows(METERING)], ids=lambda row: row.mode)
def test_the_board_takes_as_long_as_the_paper_s(row: Row) -> None:
    assert row.low_min <= row.run() <= row.high_min


def test_the_bounds_are_one_percent_and_for_the_heavy_run_150_to_180_minutes() -> None:
    assert [row.paper_min for row in ROWS] == PAPER_MIN
    for row in ROWS[:5]:
        assert (row.low_min, row.high_min) == pytest.approx((0.99 * row.paper_min, 1.01 * row.paper_min))
    assert (ROWS[5].low_min, ROWS[5].high_min) == (150, 180)


def test_fewer_parameters_were_fitted_than_there_are_rows_and_each_names_its_row() -> None:
    rows = [parameter.fitted_to for parameter in FITTED]
    assert len(set(rows)) == len(rows) < len(ROWS)
    assert all(parameter.source for parameter in (*FITTED, *TAKEN, *ASSUMED, *METERED))


def test_the_idle_load_is_equation_1() -> None:
    # FULL / 60 000 grains a millisecond are 1 a minute.
    assert LOADS.total(IDLE) * 60_000 == pytest.approx(0.0010427134 * FULL)


def test_the_charging_times_do_not_superpose_without_the_power_path() -> None:
    # By hand, equation (2) by 1.2435 under the whole idle load: its slow part alone takes 0.16197 / 0.00025675 = 630.8 min.
    slow = MODEL.segments_by_two[0][1] - LOADS.total(IDLE)
    assert MODEL.segments_by_two[0][0] / slow / 60_000 == pytest.approx(630.8, rel=0.001)
    assert LOADS.of[Rail.MOTORS] == max(LOADS.of)
