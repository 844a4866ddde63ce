from __future__ import annotations

import json
import re
import shutil
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager, redirect_stdout
from io import StringIO
from itertools import pairwise
from pathlib import Path
from typing import Any

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
    of_1, of_2 = [row(1, 0.0, 0.03, 0.01), row(1, 3.0, 0.0, 0.01)], [row(2, 3.0, -0.04, 0.04)]
    scores = scores_of([*of_1, *of_2, row(2, 30, 0.0, 0.0, True)])
    overall, first, second = scores.overall, scores.by_agent["1"], scores.by_agent["2"]
    found = (overall.rmse, overall.bias, overall.coverage, overall.nees, overall.crps, first.crps)
    assert found == pytest.approx((0.025, -0.0025, 0.75, (9 + 0 + 1) / 3, (0.03 + 0.04) / 4, 0.015))
    samples = [(name, score.samples) for name, score in scores.by_age.items()]
    assert samples == [("a minute", 1), ("6 h", 2), ("48 h", 1)]
    assert (second.coverage, second.place_rmse_m, list(scores.by_mode)) == (1.0, None, ["idle"])
    assert scores_of([]) is None
    bins = [age_bin(age_h) for age_h in (0.0, 0.5, 24.0, 24.1, 100)]
    assert bins == ["a minute", "1 h", "24 h", "48 h", "older"]
    certain = scores_of([row(1, 0.0, 0.03, None)]).overall
    assert (certain.coverage, certain.nees) == (None, None)


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
def run(tmp_path: Path, flown: Flown) -> Path:
    return flown(tmp_path, False)


@pytest.fixture
def twin_run(tmp_path: Path, flown: Flown) -> Path:
    return flown(tmp_path, True)


Told = Callable[..., tuple[Any, str]]


@pytest.fixture
def beliefs(capsys: pytest.CaptureFixture[str]) -> Told:
    """What `musselbed beliefs` tells of a run: its JSON, or its text, and its errors."""

    def told(run: Path, *words: str, code: int = 0) -> tuple[Any, str]:
        capsys.readouterr()
        assert main(["beliefs", str(run), *words]) == code
        out, errors = capsys.readouterr()
        return (json.loads(out) if "--json" in words else out), errors

    return told


@contextmanager
def bag_of(run: Path) -> Iterator[BagWriter]:
    """A bag in the place of the run's."""
    (run / "run.bag").unlink()
    with closing(BagWriter(run / "run.bag", TimeScale(30))) as bag:
        yield bag


def test_released_aMussels_and_the_secondary_battery_have_rows_of_their_own(run: Path, beliefs: Told) -> None:
    place, charges = (10.0, 20.0), (0.01, 0.02, 0.0, 0.48, 0.52)
    truth = TruthSample(1, int(State.RELEASED), 0.6, 0.9, *place, 0.0, False, 0)
    belief = BeliefSample(1, int(State.RELEASED), 0.5, 0.93, *place, 0.0, *charges)
    second = truth._replace(agent_id=2, state=int(State.FLOATING), primary=0.51, secondary=0.8)
    with bag_of(run) as bag:
        for n in range(60):
            bag.sample(10_000 * n, [truth, second], [belief, belief._replace(agent_id=2)], None)
    found, errors = beliefs(run, "--json")
    assert {name: (it["samples"], it["coverage"]) for name, it in found["by_mode"].items()} == {
        "floating": (120, 0.5),
        "released": (60, 0.0),
    }
    # 0.03 away is within 1.96 deviations of 0.02, and 0.13 is not.
    secondary, lines = found["secondary"], errors.splitlines()
    assert (found["overall"]["width"], secondary["coverage"]) == (pytest.approx(0.04), 0.5)
    assert secondary["width"] == pytest.approx(2 * 0.0392, abs=1e-4)
    assert all(it.startswith("warning: ") for it in lines) and " mode released: " in errors


def test_the_figure_shows_error_and_coverage_in_each_bin() -> None:
    scores = scores_of([row(1, 3.0, 0.03, 0.01), row(2, 3.0, 0.01, 0.01), row(2, 30, 0.01, None)])
    assert scores is not None
    *panels, _, _, of_agents = figure_of(scores, "a title").axes
    heights = [bar.get_height() for panel in panels for bar in panel.patches]
    # By age, of which the first is of 0.03 and 0.01; by mode; by aMussel.
    assert heights == pytest.approx([0.0005**0.5, 0.01, (0.0011 / 3) ** 0.5, 0.03, 0.01])
    assert [len(panel.patches) for panel in panels] == [2, 1, 2]
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


def test_a_flight_on_twins_is_compared(tmp_path: Path, twin_run: Path, beliefs: Told) -> None:
    picture = tmp_path / "beliefs.png"
    found, _ = beliefs(twin_run, "--json", "--figure", str(picture))
    overall = found["overall"]
    assert (overall["samples"], overall["mode_right"], set(found["by_agent"])) == (
        3 * 9,
        1.0,
        {"1", "2", "3"},
    )
    assert overall["rmse"] < 0.003 and overall["coverage"] > 0.8
    assert picture.read_bytes()[:8] == b"\x89PNG\r\n\x1a\n"
    assert "packet up to" in beliefs(twin_run)[0]


def test_the_bag_and_the_journal_of_a_run_say_the_same(twin_run: Path, beliefs: Told) -> None:
    bag, journal = (
        {(it.at_ms, it.agent_id): it for it in comparisons_in(twin_run, 5_000, record)} for record in Record
    )
    assert len(bag) == 3 * 18 and set(bag) == set(journal)
    for key, it in bag.items():
        other = journal[key]
        said, expected = ((one.mode, one.mode_right, one.primary.clamped) for one in (it, other))
        assert said == expected
        # The journal repeats a belief when it has moved by a third of its deviation.
        assert it.primary.error == pytest.approx(other.primary.error, abs=max(0.0015, it.primary.deviation))
        assert it.primary.deviation == pytest.approx(other.primary.deviation, abs=0.0011)
        assert it.place_square is not None and other.place_square is None
    for record in Record:
        output, _ = beliefs(twin_run, "--json", "--from", record)
        assert (output["record"], output["overall"]["samples"]) == (record, 3 * 9)
        assert (output["overall"]["place_coverage"] is None) is (record is Record.JOURNAL)


def test_an_instant_of_a_bag_is_scored_by_hand(run: Path) -> None:
    truth = TruthSample(7, int(State.ACTIVE), 0.5, 1.0, 10.0, 20.0, 3.0, False, 0)
    # Deviations of 2 m north and 1 m east with a correlation of 0.5: 4 m off to the north is (4 / 2)^2 / (1 - 0.5^2).
    charges, places = (0.02, 0.0, 0.0, 0.49, 0.57), (2.0, 1.0, 1.0)
    belief = BeliefSample(7, int(State.ACTIVE), 0.53, 1.0, 14.0, 20.0, 60.0, *charges, *places, (), 0.0, 0.0)
    docked = truth._replace(agent_id=8, docked=True, state=int(State.CHARGING))
    # It obeyed, or it stayed: a quarter is 0.1 too high, and three quarters are right.
    two = (0.25, 0.6, 0.0, 0.75, 0.5, 0.0)
    other = belief._replace(agent_id=8, charge_low=0.51, charge_parts=two)
    with bag_of(run) as bag:
        bag.sample(10_000, [truth, docked], [belief, other], None)
    first, second = comparisons_in(run, 10_000, Record.BAG)
    charge = first.primary
    found = first.age_h, charge.error, charge.deviation, first.place_error_m, first.place_square
    assert found == pytest.approx((0.5, 0.03, 0.02, 4.0, 16 / 3))
    assert (first.mode, first.mode_right, first.primary.covered) == (Mode.IDLE, True, True)
    assert (second.primary.covered, second.place_error_m, second.place_square) == (False, None, None)
    # 1.5 deviations of 0.02 away: 0.02 (1.5 (2 cdf(1.5) - 1) + 2 pdf(1.5) - 1 / sqrt(pi)).
    # Of the second the integrand is the square of a quarter from 0.5 to 0.6.
    expected = 0.02 * (1.5 * 0.86639 + 2 * 0.12952 - 0.56419), 0.1 / 16
    assert (first.primary.crps, second.primary.crps) == pytest.approx(expected, rel=1e-4)
    overall = scores_of([first, second]).overall
    # 5.33 is below 5.99, the limit of 95 % in two dimensions.
    assert (overall.place_coverage, overall.place_nees) == (1.0, pytest.approx(8 / 3))
    assert overall.nees == pytest.approx(2.25, rel=1e-4)


def test_what_mostly_rests_at_an_end_is_told_by_its_moments(run: Path) -> None:
    """The moments are of many charges drawn from a Gaussian and clamped, not from the closed form."""
    truths, beliefs = [], []
    for agent_id, mean in enumerate((0.995, 1.005, 0.004, -0.003)):
        held = np.clip(np.random.default_rng(1).normal(mean, 0.02, 1_000_000), 0, 1)
        low, high = np.quantile(held, [0.025, 0.975])
        place = (10.0, 20.0)
        truths.append(TruthSample(agent_id, int(State.ACTIVE), 0.5, 1.0, *place, 3.0, False, 0))
        charges = (held.std(), 0.0, 0.0, low, high)
        beliefs.append(BeliefSample(agent_id, int(State.ACTIVE), held.mean(), 1.0, *place, 0.0, *charges))
    with bag_of(run) as bag:
        bag.sample(10_000, truths, beliefs, None)
    clamped = [row.primary.clamped for row in comparisons_in(run, 10_000, Record.BAG)]
    assert clamped == [False, True, False, True]


def test_a_run_whose_bag_is_torn_is_compared_by_its_journal(
    tmp_path: Path, twin_run: Path, beliefs: Told, capsys: pytest.CaptureFixture[str]
) -> None:
    run, bag = twin_run, twin_run / "run.bag"
    bag.write_bytes(bag.read_bytes()[: bag.stat().st_size // 2])
    found, errors = beliefs(run, "--json")
    (line,) = [it for it in errors.splitlines() if "warning: " not in it]
    assert line.startswith(f"musselbed beliefs: {bag}: not a bag that can be read")
    assert line.endswith("; the journal is read instead") and found["record"] == "journal"
    assert main(["report", str(run), "--data", "none", "--out", str(tmp_path / "report")]) == 0
    page = (tmp_path / "report" / "report.html").read_text()
    assert f"By the journal: {bag}: not a bag that can be read" in page
    assert "not a bag" not in beliefs(run, "--from", "journal")[1]
    _, errors = beliefs(run, "--from", "bag", code=2)
    assert errors.count("\n") == 1 and errors.endswith("try --from journal\n")


def test_a_journal_of_another_version_is_told_in_one_line(run: Path, beliefs: Told) -> None:
    journal = run / "journal.jsonl"
    batteries = re.compile(r'"primary": ?\[(\d+), ?(\d+), ?(-?\d+), ?[^]]*\]')
    journal.write_text(batteries.sub(r'"primary":[\1,\2,\3]', journal.read_text()))
    _, errors = beliefs(run, "--from", "journal", code=2)
    assert "a line `truth` with a wrong `primary`" in errors and "the version that flew the run" in errors
    assert errors.count("\n") == 1 and "journal.jsonl, line " in errors


def test_a_run_with_a_bag_of_means_is_scored(
    twin_run: Path, beliefs: Told, bag_of_means: Callable[..., Path]
) -> None:
    (twin_run / "run.bag").unlink()
    bag_of_means(twin_run / "run.bag", seconds=31)
    found, errors = beliefs(twin_run, "--json")
    assert "run.bag: its beliefs have no deviations; the journal is read instead\n" in errors
    overall = beliefs(twin_run, "--json", "--from", "bag")[0]["overall"]
    # It believes 0.75 for a true 0.5, and 1 m north for 1.5 m.
    expected = {"samples": 4, "rmse": 0.25, "place_rmse_m": 0.5}
    expected |= dict.fromkeys(("coverage", "nees", "place_coverage"))
    assert (found["record"], overall) == ("journal", overall | expected)


def test_mistakes_are_told_in_one_line(tmp_path: Path, beliefs: Told) -> None:
    for words in ([], ["--period", "0"], ["--figure", "beliefs.jpeg"]):
        _, errors = beliefs(tmp_path, *words, code=2)
        assert errors.count("\n") == 1 and errors.startswith("musselbed beliefs: ")
