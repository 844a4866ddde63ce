from __future__ import annotations

import json
import re
import shutil
from collections.abc import Callable
from contextlib import redirect_stdout
from io import StringIO
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scenario_files import POOL_FILE, SCENARIO_FILES
from scipy.integrate import quad
from scipy.special import ndtr

from agents.time_scale import TimeScale
from apad_bridge.analysis.belief_scores.comparisons import (
    BeliefComparison,
    ChargeComparison,
    Record,
    comparisons_in,
)
from apad_bridge.analysis.belief_scores.crps import crps
from apad_bridge.analysis.belief_scores.score_figure import figure_of
from apad_bridge.analysis.belief_scores.scores import age_bin, scores_of
from apad_bridge.beliefs.mixture import Gaussian
from apad_bridge.beliefs.modes import Mode
from apad_bridge.commands.main import main
from apad_bridge.records.bag import BagWriter
from apad_bridge.records.samples import BeliefSample, TruthSample
from firmware_model.states import State

TWIN = """beliefs:
  estimator: twin
  twin: {drain_deviation: 0.01, sensor_noise: 0.002, bias_deviation: 0.0005, unscheduled: 0.001, fix_deviation_m: 0.05}
"""


def row(
    agent_id: int, age_h: float, error: float, deviation: float | None, clamped: bool = False
) -> BeliefComparison:
    covered = None if deviation is None else abs(error) <= 1.96 * deviation
    width = None if deviation is None else 2 * 1.96 * deviation
    charge = ChargeComparison(error, deviation, covered, width, clamped, crps=abs(error))
    return BeliefComparison(agent_id, 0, age_h, Mode.IDLE, False, True, charge, None, None)


def test_scores_are_counted_by_hand() -> None:
    scores = scores_of(
        [
            row(1, 0.0, 0.03, 0.01),
            row(1, 3.0, 0.0, 0.01),
            row(2, 3.0, -0.04, 0.04),
            row(2, 30, 0.0, 0.0, True),
        ]
    )
    assert scores.overall.rmse == pytest.approx(0.025)
    assert (scores.overall.bias, scores.overall.coverage) == (pytest.approx(-0.0025), 0.75)
    assert scores.overall.nees == pytest.approx((9 + 0 + 1) / 3)
    assert scores.overall.crps == pytest.approx((0.03 + 0.04) / 4)
    assert scores.by_agent["1"].crps == pytest.approx(0.015)
    assert {name: score.samples for name, score in scores.by_age.items()} == {
        "a minute": 1,
        "6 h": 2,
        "48 h": 1,
    }
    assert scores.by_agent["2"].coverage == 1.0 and scores.by_agent["2"].place_rmse_m is None
    assert list(scores.by_mode) == ["idle"]
    assert scores_of([]) is None
    assert [age_bin(age_h) for age_h in (0.0, 0.5, 24.0, 24.1, 100)] == [
        "a minute",
        "1 h",
        "24 h",
        "48 h",
        "older",
    ]


def test_beliefs_that_claim_to_be_certain_have_no_coverage() -> None:
    scores = scores_of([row(1, 0.0, 0.03, None)])
    assert scores is not None and scores.overall.coverage is None and scores.overall.nees is None


@settings(max_examples=60, deadline=None)
@given(
    parts=st.lists(
        st.tuples(st.floats(0.05, 1.0), st.floats(-0.3, 1.3), st.sampled_from([0.0, 0.002, 0.05, 0.6])),
        min_size=1,
        max_size=4,
    ),
    true=st.floats(0.0, 1.0),
)
@example(parts=[(1.0, 0.5, 0.1)], true=0.5)
@example(parts=[(0.7, 0.5, 0.02), (0.3, 0.5, 0.1)], true=0.5)
@example(parts=[(0.7, 1.0, 0.02), (0.3, 0.0, 0.1)], true=1.0)
@example(parts=[(0.5, 0.0, 0.05), (0.5, 5e-324, 0.6)], true=0.3)
def test_the_crps_is_the_integral_that_defines_it(
    parts: list[tuple[float, float, float]], true: float
) -> None:
    whole = sum(weight for weight, _, _ in parts)
    its = [Gaussian(weight / whole, mean, sd) for weight, mean, sd in parts]

    def square(x: float) -> float:
        # The probability of at most x in [0, 1), where the end at 0 holds what lies below it.
        below = sum(it.weight * (ndtr((x - it.mean) / it.sd) if it.sd else it.mean <= x) for it in its)
        return float((below - (x >= true)) ** 2)

    steps = {min(1.0, max(0.0, it.mean + z * it.sd)) for it in its for z in (-7, -3, 0, 3, 7)}
    integral = sum(quad(square, *ends, epsabs=1e-9)[0] for ends in pairwise(sorted({0.0, true, *steps, 1.0})))
    assert crps(its, true) == pytest.approx(integral, abs=1e-6)


def test_bins_of_overconfident_beliefs_are_named() -> None:
    sure, unsure = [row(1, 0.0, 0.03, 0.01)] * 50, [row(2, 30.0, 0.01, 0.01)] * 60
    scores = scores_of([*sure, *unsure])
    assert list(scores.overconfident) == ["all", "packet up to a minute", "mode idle", "aMussel 1"]
    few = scores_of([*sure[1:], *unsure])
    # 49 samples say too little for a bin of their own.
    assert few is not None and list(few.overconfident) == ["all", "mode idle"]


@pytest.fixture
def run(tmp_path: Path, flown: Flown) -> Flown:
    return flown(tmp_path, False)


def test_released_aMussels_and_the_secondary_battery_have_rows_of_their_own(
    run: Flown, capsys: pytest.CaptureFixture[str]
) -> None:
    (run / "run.bag").unlink()
    bag = BagWriter(run / "run.bag", TimeScale(30))
    place, charges = (10.0, 20.0), (0.01, 0.02, 0.0, 0.48, 0.52)
    truth = TruthSample(1, int(State.RELEASED), 0.6, 0.9, *place, 0.0, False, 0)
    belief = BeliefSample(1, int(State.RELEASED), 0.5, 0.93, *place, 0.0, *charges)
    second = truth._replace(agent_id=2, state=int(State.FLOATING), primary=0.51, secondary=0.8)
    for second_of_mission in range(60):
        bag.sample(10_000 * second_of_mission, [truth, second], [belief, belief._replace(agent_id=2)], None)
    bag.close()
    capsys.readouterr()  # of the flight
    assert main(["beliefs", str(run), "--json"]) == 0
    output, errors = capsys.readouterr()
    found = json.loads(output)
    assert {name: (it["samples"], it["coverage"]) for name, it in found["by_mode"].items()} == {
        "floating": (120, 0.5),
        "released": (60, 0.0),
    }
    assert found["overall"]["width"] == pytest.approx(0.04)
    # 0.03 away is within 1.96 deviations of 0.02, and 0.13 is not.
    secondary = found["secondary"]
    assert secondary["coverage"] == 0.5 and secondary["width"] == pytest.approx(2 * 0.0392, abs=1e-4)
    warned = [line for line in errors.splitlines() if line.startswith("warning: ")]
    assert len(warned) == len(errors.splitlines()) and any(" mode released: " in line for line in warned)


def test_the_figure_shows_error_and_coverage_in_each_bin() -> None:
    scores = scores_of([row(1, 3.0, 0.03, 0.01), row(2, 3.0, 0.01, 0.01), row(2, 30, 0.01, None)])
    assert scores is not None
    *panels, _, _, of_agents = figure_of(scores, "a title").axes
    heights = [[bar.get_height() for bar in panel.patches] for panel in panels]
    both = (0.0005) ** 0.5  # of 0.03 and 0.01
    assert heights[0] == pytest.approx([both, 0.01]), "by age"
    assert heights[1] == pytest.approx([(0.0011 / 3) ** 0.5]), "by mode"
    assert heights[2] == pytest.approx([0.03, 0.01]), "by aMussel"
    assert [it.get_text() for it in panels[0].get_xticklabels()] == ["6 h", "48 h"]
    assert [it.get_text() for it in panels[2].texts] == ["n 1", "n 2"]
    # aMussel 1 is outside of its interval; of aMussel 2 one sample claims to have one, and lies in it.
    assert of_agents.lines[0].get_xydata().tolist() == [[0, 0], [1, 1]]


Flown = Callable[[Path, bool], Path]


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> Flown:
    """Copies a run into a folder, where a test may change it: a flight on twins or without, flown when first wanted."""
    runs: dict[bool, Path] = {}

    def copy_to(folder: Path, twins: bool) -> Path:
        if twins not in runs:
            runs[twins] = fly(tmp_path_factory.mktemp("flown"), twins)
        return Path(shutil.copytree(runs[twins], folder / "run"))

    return copy_to


def fly(folder: Path, twins: bool) -> Path:
    text = POOL_FILE.read_text()
    text = text.replace("duration_s: 2400", "duration_s: 90").replace(
        "count: 12", "count: 3\n  hosting: one_process"
    )
    (folder / "few.yaml").write_text(text + (TWIN if twins else ""))
    (folder / "pool.csv").write_text((SCENARIO_FILES / "pool.csv").read_text())
    with redirect_stdout(StringIO()):
        assert main(["run", str(folder / "few.yaml"), "--time", "asap", "--out", str(folder / "run")]) == 0
    return folder / "run"


def test_a_flight_on_twins_is_compared(
    tmp_path: Path, flown: Flown, capsys: pytest.CaptureFixture[str]
) -> None:
    run = flown(tmp_path, True)
    picture = tmp_path / "beliefs.png"
    assert main(["beliefs", str(run), "--json", "--figure", str(picture)]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["overall"]["samples"] == 3 * 9 and set(found["by_agent"]) == {"1", "2", "3"}
    assert found["overall"]["rmse"] < 0.003 and found["overall"]["coverage"] > 0.8
    assert found["overall"]["mode_right"] == 1.0
    assert picture.read_bytes()[:8] == b"\x89PNG\r\n\x1a\n"
    assert main(["beliefs", str(run)]) == 0
    assert "packet up to" in capsys.readouterr().out


def test_the_bag_and_the_journal_of_a_run_say_the_same(
    tmp_path: Path, flown: Flown, capsys: pytest.CaptureFixture[str]
) -> None:
    run = flown(tmp_path, True)
    bag, journal = (
        {(it.at_ms, it.agent_id): it for it in comparisons_in(run, 5_000, record)} for record in Record
    )
    assert len(bag) == 3 * 18 and set(bag) == set(journal)
    for key, it in bag.items():
        other = journal[key]
        assert (it.mode, it.mode_right, it.primary.clamped) == (
            other.mode,
            other.mode_right,
            other.primary.clamped,
        )
        # The journal repeats a belief when it has moved by a third of its deviation.
        assert it.primary.deviation is not None and other.primary.deviation is not None
        assert it.primary.error == pytest.approx(other.primary.error, abs=max(0.0015, it.primary.deviation))
        assert it.primary.deviation == pytest.approx(other.primary.deviation, abs=0.0011)
        assert it.place_square is not None and other.place_square is None
    for record in Record:
        assert main(["beliefs", str(run), "--json", "--from", record]) == 0
        output = json.loads(capsys.readouterr().out)
        assert output["record"] == record and output["overall"]["samples"] == 3 * 9
        assert (output["overall"]["place_coverage"] is None) is (record is Record.JOURNAL)


def test_an_instant_of_a_bag_is_scored_by_hand(run: Flown) -> None:
    (run / "run.bag").unlink()
    bag = BagWriter(run / "run.bag", TimeScale(30))
    truth = TruthSample(7, int(State.ACTIVE), 0.5, 1.0, 10.0, 20.0, 3.0, False, 0)
    # Deviations of 2 m north and 1 m east with a correlation of 0.5: 4 m off to the north is (4 / 2)^2 / (1 - 0.5^2).
    belief = BeliefSample(
        7,
        int(State.ACTIVE),
        0.53,
        1.0,
        14.0,
        20.0,
        60.0,
        0.02,
        0.0,
        0.0,
        0.49,
        0.57,
        2.0,
        1.0,
        1.0,
        (),
        0.0,
        0.0,
    )
    docked = truth._replace(agent_id=8, docked=True, state=int(State.CHARGING))
    # It obeyed, or it stayed: a quarter is 0.1 too high, and three quarters are right.
    two = (0.25, 0.6, 0.0, 0.75, 0.5, 0.0)
    other = belief._replace(agent_id=8, charge_low=0.51, charge_parts=two)
    bag.sample(10_000, [truth, docked], [belief, other], None)
    bag.close()
    first, second = comparisons_in(run, 10_000, Record.BAG)
    assert first.age_h == pytest.approx(0.5) and first.mode is Mode.IDLE and first.mode_right
    assert first.primary.error == pytest.approx(0.03) and first.primary.deviation == pytest.approx(0.02)
    assert first.primary.covered is True and second.primary.covered is False
    assert first.place_error_m == 4.0 and first.place_square == pytest.approx(16 / 3)
    assert second.place_error_m is None and second.place_square is None
    # 1.5 deviations of 0.02 away: 0.02 (1.5 (2 cdf(1.5) - 1) + 2 pdf(1.5) - 1 / sqrt(pi)).
    assert first.primary.crps == pytest.approx(0.02 * (1.5 * 0.86639 + 2 * 0.12952 - 0.56419), rel=1e-4)
    # From 0.5 to 0.6 the integrand is the square of a quarter.
    assert second.primary.crps == pytest.approx(0.1 / 16, rel=1e-4)
    scores = scores_of([first, second])
    assert scores is not None and scores.overall.nees == pytest.approx(2.25, rel=1e-4)
    # 5.33 is below 5.99, the limit of 95 % in two dimensions.
    assert (scores.overall.place_coverage, scores.overall.place_nees) == (1.0, pytest.approx(8 / 3))


def test_what_mostly_rests_at_an_end_is_told_by_its_moments(run: Flown) -> None:
    """The moments are of many charges drawn from a Gaussian and clamped, not from the closed form."""
    (run / "run.bag").unlink()
    bag = BagWriter(run / "run.bag", TimeScale(30))
    truths, beliefs = [], []
    for agent_id, mean in enumerate((0.995, 1.005, 0.004, -0.003)):
        held = np.clip(np.random.default_rng(1).normal(mean, 0.02, 1_000_000), 0, 1)
        low, high = np.quantile(held, [0.025, 0.975])
        place = (10.0, 20.0)
        truths.append(TruthSample(agent_id, int(State.ACTIVE), 0.5, 1.0, *place, 3.0, False, 0))
        charges = (held.std(), 0.0, 0.0, low, high)
        beliefs.append(BeliefSample(agent_id, int(State.ACTIVE), held.mean(), 1.0, *place, 0.0, *charges))
    bag.sample(10_000, truths, beliefs, None)
    bag.close()
    assert [row.primary.clamped for row in comparisons_in(run, 10_000, Record.BAG)] == [
        False,
        True,
        False,
        True,
    ]


def test_a_run_whose_bag_is_torn_is_compared_by_its_journal(
    tmp_path: Path, flown: Flown, capsys: pytest.CaptureFixture[str]
) -> None:
    run = flown(tmp_path, True)
    whole = (run / "run.bag").read_bytes()
    (run / "run.bag").write_bytes(whole[: len(whole) // 2])
    capsys.readouterr()  # the flight's own lines
    assert main(["beliefs", str(run), "--json"]) == 0
    told = capsys.readouterr()
    assert json.loads(told.out)["record"] == "journal"
    (line,) = [it for it in told.err.splitlines() if "warning: " not in it]
    assert line.startswith(f"musselbed beliefs: {run / 'run.bag'}: not a bag that can be read")
    assert line.endswith("; the journal is read instead")
    assert main(["report", str(run), "--data", "none", "--out", str(tmp_path / "report")]) == 0
    page = (tmp_path / "report" / "report.html").read_text()
    assert f"By the journal: {run / 'run.bag'}: not a bag that can be read" in page
    assert main(["beliefs", str(run), "--json", "--from", "journal"]) == 0
    assert "not a bag" not in capsys.readouterr().err
    assert main(["beliefs", str(run), "--from", "bag"]) == 2
    errors = capsys.readouterr().err
    assert errors.count("\n") == 1 and errors.endswith("try --from journal\n")


def test_a_journal_of_another_version_is_told_in_one_line(
    run: Flown, capsys: pytest.CaptureFixture[str]
) -> None:
    journal = run / "journal.jsonl"
    whole = journal.read_text()
    batteries = re.compile(r'"primary": ?\[(\d+), ?(\d+), ?(-?\d+), ?[^]]*\]')
    shorter, count = batteries.subn(r'"primary":[\1,\2,\3]', whole)
    assert count > 0
    journal.write_text(shorter)
    capsys.readouterr()  # the flight's own lines, if no test before this one has flown it
    assert main(["beliefs", str(run), "--from", "journal"]) == 2
    errors = capsys.readouterr().err
    assert "a line `truth` with a wrong `primary`" in errors and "the version that flew the run" in errors
    assert errors.count("\n") == 1 and "journal.jsonl, line " in errors


def test_a_run_with_a_bag_of_means_is_scored(
    tmp_path: Path, flown: Flown, capsys: pytest.CaptureFixture[str], bag_of_means: Callable[..., Path]
) -> None:
    run = flown(tmp_path, True)
    (run / "run.bag").unlink()
    bag_of_means(run / "run.bag", seconds=31)
    assert main(["beliefs", str(run), "--json"]) == 0
    told = capsys.readouterr()
    assert json.loads(told.out)["record"] == "journal"
    assert "run.bag: its beliefs have no deviations; the journal is read instead\n" in told.err
    assert main(["beliefs", str(run), "--json", "--from", "bag"]) == 0
    overall = json.loads(capsys.readouterr().out)["overall"]
    # It believes 0.75 for a true 0.5, and 1 m north for 1.5 m.
    assert (overall["samples"], overall["rmse"], overall["place_rmse_m"]) == (4, 0.25, 0.5)
    assert overall["coverage"] is None and overall["nees"] is None and overall["place_coverage"] is None


def test_mistakes_are_told_in_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for arguments in (
        [str(tmp_path)],
        [str(tmp_path), "--period", "0"],
        [str(tmp_path), "--figure", "beliefs.jpeg"],
    ):
        assert main(["beliefs", *arguments]) == 2
        errors = capsys.readouterr().err
        assert errors.count("\n") == 1 and errors.startswith("musselbed beliefs: ")
