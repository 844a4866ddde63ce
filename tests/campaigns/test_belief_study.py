"""The study's functions on a small fleet; `tests/campaigns/run beliefs` runs the whole study."""

from __future__ import annotations

import math
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

sys.path.insert(0, str(Path(__file__).parents[3]))

import beliefs_cell.campaign as of_cells
from beliefs import filters, peers, study
from beliefs.score import crps, score
from beliefs.truth import Doing, Life, live
from beliefs_untold.campaign import HOUR_MS, Boards, Row, in_one_row

from apad_bridge.beliefs.mixture import Gaussian
from firmware_model.power.charge import FULL
from firmware_model.states import State

AGENTS, HOURS = 12, 144


@pytest.fixture(scope="module")
def life() -> Life:
    return live(7, AGENTS, HOURS)


def test_the_truth_is_possible_and_differs_from_the_plan(life: Life) -> None:
    assert life.primary.min() >= 0 and life.primary.max() <= 1
    alone = life.doing <= Doing.HIGH
    assert 0.01 < (life.doing != life.scheduled)[alone].mean() < 0.08
    docked = life.doing == Doing.DOCKED
    rising = np.diff(life.primary, axis=1)[docked[:, 1:] & docked[:, :-1]]
    assert (rising >= -1e-9).all()


def test_peers_are_filterpys_own(life: Life) -> None:
    heard = study.heard_in(life, 0.5)
    assert peers.like_filterpy(peers.kalman(0.01, 0.5), life, heard, 3) < 1e-9
    assert peers.like_filterpy(peers.imm(0.01, 0.7, 0.2), life, heard, 3) < 1e-9


def test_the_twin_is_better_than_hold_last_and_honest(life: Life, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(study, "life_of", lambda seed, agents: life)
    rows, delays = study.rows_of("twin", 7, AGENTS, True, 0.5)
    held, _ = study.rows_of("hold_last", 7, AGENTS, True, 0.5)
    ours = score(rows)
    assert ours["rmse"] < 0.06 and ours["rmse"] < score(held, certain=True)["rmse"] / 3
    assert 0.9 < ours["coverage"] < 0.99 and 0.6 < ours["nees"] < 1.6
    assert np.median(delays) == 0 and ours["mode_share"] > 0.95


def test_beliefs_come_at_every_timeslot_from_the_first_packet_on(life: Life) -> None:
    heard = np.zeros(HOURS, bool)
    heard[[5, 9]] = True
    found = list(filters.beliefs(life, 2, filters.twin(life, 2, False), heard))
    assert [hour for hour, _ in found] == list(range(5, HOURS))
    assert found[4][1].silent_timeslots == 0 and found[3][1].silent_timeslots == 3


def test_the_score_is_counted_by_hand() -> None:
    # Two rows at hour 0, one exact and one two deviations too high; one row at 30 hours, at an end and certain.
    rows = np.array(
        [
            [0, 0.5, 0.5, 0.01, 0.5, 0.5, 1, 0.0],
            [0, 0.5, 0.7, 0.01, 0.023, 0.023, 0, 0.0],
            [30, 1.0, 1.0, 0.0, 1.0, 0.0, 1, 1.0],
        ]
    )
    found = score(rows)
    assert found["rmse"] == pytest.approx(0.2 / 3**0.5)
    assert found["coverage_by_age"]["now"] == 0.5 and found["coverage"] == pytest.approx(2 / 3)
    assert found["nees"] == pytest.approx(2.0) and found["clamped"] == pytest.approx(1 / 3)
    assert found["samples_by_age"]["25-48"] == 1


@settings(max_examples=100, deadline=None)
@given(mean=st.floats(-0.5, 1.5), sd=st.floats(0.005, 0.6), charge=st.floats(0, 1))
def test_a_clamped_gaussians_crps_is_the_closed_one(mean: float, sd: float, charge: float) -> None:
    """By parts, the integral of cdf^2 up to a is a cdf^2 + 2 pdf cdf - cdf(sqrt(2) a) / sqrt(pi); the rest is symmetry."""

    def up_to(a: float) -> float:
        cdf = math.erfc(-a / math.sqrt(2)) / 2
        pdf = math.exp(-a * a / 2) / math.sqrt(2 * math.pi)
        return a * cdf**2 + 2 * pdf * cdf - math.erfc(-a) / 2 / math.sqrt(math.pi)

    z, low, high = ((it - mean) / sd for it in (charge, 0.0, 1.0))
    expected = sd * (up_to(z) - up_to(low) + up_to(-z) - up_to(-high))
    assert crps([Gaussian(1.0, mean, sd)], charge) == pytest.approx(expected, abs=2e-5 * sd)


def test_the_crps_of_a_certain_belief_is_its_error() -> None:
    assert crps([Gaussian(1.0, 0.4, 0.0)], 0.4) == 0
    assert crps([Gaussian(1.0, 0.4, 0.0)], 0.7) == pytest.approx(0.3)
    # Two certain halves, 0.2 below and 0.2 above: a quarter of each way.
    assert crps([Gaussian(0.5, 0.3, 0.0), Gaussian(0.5, 0.7, 0.0)], 0.5) == pytest.approx(0.1)


def sampled(agent_id: int, hour: float, suspect: bool = False, stood_ms: float = -math.inf) -> Row:
    """One deviation too high, in an interval that holds the truth."""
    nothing = math.nan, math.nan
    at_ms = round(hour * HOUR_MS)
    head = (agent_id, State.SLEEPING, 0, 0.01, 0.01, True, 0.04, False, True)
    return Row(*head, *nothing, suspect, "", 0.5, 0.002, at_ms, stood_ms)


def test_false_alarms_are_suspicions_that_begin_while_nothing_is_wrong() -> None:
    # aMussel 2 is suspect twice within a week; aMussel 3 first when its reading has stood for a day.
    rows = [sampled(2, hour, suspect=hour in (42, 84, 168)) for hour in (0, 42, 84, 126, 168)]
    rows += [sampled(3, 0), sampled(3, 84), sampled(3, 108, suspect=True, stood_ms=24 * HOUR_MS)]
    found = in_one_row({"boards": Boards.STANDING}, [rows])
    assert (found["alarms"], found["board_weeks"]) == (2, 1.5)
    assert found["nees"] == found["nees_min"] == pytest.approx(1.0) and found["coverage_max"] == 1.0


def cell_of_a_resistance() -> of_cells.Cell:
    """A straight cell: 3.6 V and 0.6 V by charge, less 0.2 V a window an hour, and 1 mV more a degree above 5."""
    grid = [n / 100 for n in range(101)]
    rows = {
        celsius: [
            (current, [3.6 + 0.6 * q - 0.2 * current + 0.001 * (celsius - 5) for q in grid])
            for current in (-0.2, 0.0, 0.2)
        ]
        for celsius in (5.0, 25.0)
    }
    charge = ([0.0, 600.0], [-0.1, 1.1])
    return of_cells.Cell("straight", rows, [charge, charge], [(0, 0.0), (100, 0.1)], {})


def test_a_cell_reads_as_its_curves_and_charges_as_they_rise() -> None:
    cell = cell_of_a_resistance()
    assert cell.resting(0.5, 5.0) == pytest.approx(0.5) and cell.resting(1.0, 25.0) == 1.0
    # 0.1 windows an hour take 20 mV, and 10 degrees give 10 mV: of 600 mV.
    assert cell.scaled(0.255, 0.1, 15.0) == pytest.approx(0.255 - 0.010 / 0.6)
    assert cell.scaled(0.5, 0.4, 5.0) == pytest.approx(0.5 - 0.08 / 0.6), "beyond the last current"
    assert cell.lost_after(50) == pytest.approx(0.05)
    # 1.2 in 600 minutes is 0.002 a minute, in each piece.
    assert {rate for _, rate in cell.segments(2)} == {round(0.002 * FULL / 60_000)}
    assert cell.segments(1)[-1][0] == FULL


def test_a_machine_without_pybamm_skips_the_cells_in_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(of_cells, "KEPT", tmp_path / "kept")
    monkeypatch.setattr(sys, "executable", str(tmp_path / "none"))
    (line,) = of_cells.measure(row=["Ai2020"]).values()
    assert line.startswith("PyBaMM cannot be had: ") and "none" in line and "\n" not in line
