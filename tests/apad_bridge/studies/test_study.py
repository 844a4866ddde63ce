"""Studies: what a file may say, how a study goes on after a kill, and what its results hold."""

from __future__ import annotations

import io
import json
import math
import os
import re
import signal
import subprocess
import sys
from pathlib import Path
from random import Random
from typing import Any

import numpy as np
import pytest
import scipy.stats
from hypothesis import given
from hypothesis import strategies as st
from scenario_files import POOL_FILE, WHOLE_FILE

from apad_bridge.commands.main import main
from apad_bridge.planning.registry import Trust
from apad_bridge.scenario.errors import ScenarioError, UserError
from apad_bridge.scenario.loader import load, resolve, write_resolved
from apad_bridge.scenario.starts import starts_of
from apad_bridge.studies import runner
from apad_bridge.studies.mission_figures import COLUMNS
from apad_bridge.studies.runner import JOURNAL, StudyFailed, fly_study
from apad_bridge.studies.specification import (
    STUDY_FILE,
    StudyPlan,
    load_study,
    plan_of,
    with_seeds,
    write_study,
)

SHIPPED = Path(__file__).parents[3] / "launch_scripts/studies"
STUDY = {
    "name": "short",
    "scenarios": [str(POOL_FILE)],
    "strategies": ["cautious", "greedy"],
    "seeds": 4,
    "parameters": {"duration_s": [300.0]},
}


def plan(**changes: Any) -> StudyPlan:
    return plan_of({**STUDY, **changes}, "test", Path("/"))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"strategies": ["gready"]}, "unknown strategy 'gready'; known: .*greedy"),
        ({"strategies": ["greedy", "greedy"]}, "a name occurs twice"),
        ({"baseline": "none"}, "baseline: none is none of the strategies: cautious, greedy"),
        ({"primary": "joy"}, "primary: joy is no column; columns are amussels_lost, samples_taken"),
        ({"parameters": {"mission.batsch": [1]}}, "mission.batsch"),
        ({"parameters": {"misson.batch": [1]}}, "no such block"),
        ({"cells": {"small": {"duration_s": 60.0}}}, "cells: duration_s: parameters has this, too"),
        ({"cells": {"small": {"apad.docks": 2}}}, "4 aMussels do not fit into 2 docks"),
        ({"parameters": {"mission.batch": [9]}}, "9 aMussels do not fit into 4 docks"),
        (
            {"scenarios": [str(WHOLE_FILE)]},
            r"the event-driven model leaves out board.whole.* Say `model: mission`",
        ),
        ({"draws": {"area.size": [1]}}, "area.size"),
        ({"draws": {"mission.batch": [4, 9]}}, "9 aMussels do not fit into 4 docks"),
        ({"draws": {"duration_s": [300.0]}}, "draws: duration_s: no seed decides this"),
        ({"draws": {"theta": [30]}}, "draws: theta: no seed decides this"),
        ({"seeds": 0}, "seeds"),
        ({"colour": "red"}, "colour"),
    ],
)
def test_a_mistake_is_one_line_before_anything_is_flown(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(ScenarioError, match=message):
        plan(**changes)


@pytest.mark.parametrize("file", sorted(SHIPPED.glob("*.yaml")), ids=lambda file: file.stem)
def test_a_shipped_study_is_right(file: Path) -> None:
    assert load_study(file).missions > 0


def test_a_run_needs_no_package_of_studies_and_prints_what_nobody_can_exceed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    scenario = tmp_path / "short.yaml"
    write_resolved(scenario, plan().scenario(0, 0, 1))
    arguments = ["--time", "asap", "--hosting", "one_process", "--out", str(tmp_path / "run")]
    assert main(["run", str(scenario), *arguments]) == 0
    assert "4 docks sustain at most 15.2 aMussels (12.0" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["table2", "--theta", "0"], "--theta 0: must be 1 or more"),
        (["pool-12", "--seeds", "-1"], "--seeds -1: must be 1 or more"),
        (["sleep", "--theta", "1"], "--theta works with table2 only"),
        (["table2"], "pyarrow, which writes the results, is missing"),
    ],
)
def test_what_no_study_can_fly_is_told_before_it_flies(
    words: list[str],
    told: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    if words == ["table2"]:
        monkeypatch.setattr("apad_bridge.studies.commands.study.find_spec", lambda name: None)
    assert main(["study", *words, "--out", str(tmp_path / "out")]) == 2
    assert told in capsys.readouterr().err and not (tmp_path / "out").exists()


def test_a_study_multiplies_settings_strategies_and_seeds() -> None:
    home = {"charging_w": 300.0, "go_at": 0.2}
    found = plan(
        parameters={
            "duration_s": [300.0],
            "theta": [1, 30],
            "mission.batch": [1, 4],
            "apad.home": [None, home],
        },
        strategies=["greedy", {"collection": "cautious", "full_threshold": 0.9}],
    )
    assert found.missions == 8 * 2 * 4 == len(found.settings) * len(found.strategies) * len(found.seeds)
    assert found.settings[0].label == "pool, duration_s 300.0, mission.batch 1, apad.home None, theta 1"
    one, other = found.scenario(len(found.settings) - 1, 1, 3), found.scenario(0, 0, 1)
    assert (one.seed, one.theta, one.mission.batch, one.mission.full_threshold) == (3, 30, 4, 0.9)
    assert (other.apad.home, one.apad.home.go_at) == (None, 0.2)
    assert found.strategies[1] == "collection cautious, full_threshold 0.9"


def test_a_mission_of_a_whole_board_is_flown_tick_by_tick_where_asked(tmp_path: Path) -> None:
    (row,) = fly_study(
        plan(scenarios=[str(WHOLE_FILE)], strategies=["cautious"], seeds=1, model="mission"), tmp_path, 1
    )
    assert row["samples_taken"] > 0 and 0 < row["longest_gap_h"] <= 300 * 30 / 3600


def test_a_study_that_was_killed_goes_on_from_its_whole_lines(tmp_path: Path) -> None:
    study, told = plan(), []
    counts = iter((1, 2))  # the first call tells what was there
    with pytest.raises(StopIteration):
        fly_study(study, tmp_path / "killed", 1, lambda _: next(counts))
    journal = tmp_path / "killed" / JOURNAL
    kept = journal.read_text()
    journal.write_text(kept + '{"block": [0, 3], "rows": [{"se')
    rows = fly_study(study, tmp_path / "killed", 1, told.append)
    assert told == [4, 2, 2] and journal.read_text().startswith(kept)
    assert rows == fly_study(study, tmp_path / "whole", 1)


def assert_another(study: StudyPlan, out: Path) -> None:
    with pytest.raises(UserError, match=r"holds the missions of another study.*--out"):
        fly_study(study, out, 1)


def test_more_seeds_add_to_a_study_and_another_study_is_refused(tmp_path: Path) -> None:
    few, told = fly_study(with_seeds(plan(), 2), tmp_path, 1), list[int]()
    assert fly_study(with_seeds(plan(), 3), tmp_path, 1, told.append)[:4] == few
    assert told == [4, 2]
    assert_another(plan(strategies=["greedy"]), tmp_path)


def test_each_seed_draws_for_all_strategies_alike(tmp_path: Path) -> None:
    charges, areas = [[0.1, 0.2], [0.8, 0.9]], [[[0, 0], [8, 0], [8, 8]], [[50, 0], [58, 0], [58, 8]]]
    drawing = plan(draws={"fleet.start.charge": charges, "area.polygon_m": areas}, seeds=12)
    fleets = [
        [starts_of(drawing.scenario(0, strategy, seed)) for strategy in (0, 1)] for seed in drawing.seeds
    ]
    assert all(own == others for own, others in fleets)
    drawn = {(fleet[0].primary > 0.5, fleet[0].north_m > 20) for fleet, _ in fleets}
    assert drawn == {(False, False), (False, True), (True, False), (True, True)}
    fly_study(with_seeds(drawing, 2), tmp_path, 1)
    write_study(drawing, tmp_path)
    again = load_study(tmp_path / STUDY_FILE)
    assert [again.drawn(seed) for seed in again.seeds] == [drawing.drawn(seed) for seed in drawing.seeds]
    assert again.fingerprint == drawing.fingerprint
    assert_another(plan(draws={"fleet.start.charge": charges}), tmp_path)


def test_a_cell_decides_several_keys_together(tmp_path: Path) -> None:
    cells = {
        "wide": {"area.polygon_m": [[0, 0], [80, 0], [80, 80]], "fleet.count": 3},
        "with two docks": {"apad.docks": 2, "mission.batch": 2},
    }
    study = plan(cells=cells, seeds=1)
    assert [it.label for it in study.settings] == [
        f"pool, cell {name}, duration_s 300.0, theta 30" for name in cells
    ]
    wide, narrow = (study.scenario(setting, 0, 1) for setting in (0, 1))
    found = [(len(it.fleet.ids), it.apad.docks, it.mission.batch) for it in (wide, narrow)]
    assert found == [(3, 4, 4), (12, 2, 2)] and max(it.north_m for it in starts_of(wide)) > 28
    fly_study(study, tmp_path, 1)
    assert load_study(tmp_path / STUDY_FILE).fingerprint == study.fingerprint
    assert_another(plan(cells={**cells, "wide": {"fleet.count": 3}}, seeds=1), tmp_path)


CLUSTERS_M = [
    [0, 0],
    [14, 0],
    [14, 6.9],
    [60, 6.9],
    [60, 0],
    [74, 0],
    [74, 14],
    [60, 14],
    [60, 7.1],
    [14, 7.1],
]
AREAS_M = {
    "line of 100 m": [[0, 0], [100, 0], [100, 1], [0, 1]],
    "two clusters": [*CLUSTERS_M, [14, 14], [0, 14]],
    "60 x 20 m": [[0, 0], [60, 0], [60, 20], [0, 20]],
    "12 x 60 m": [[0, 0], [12, 0], [12, 60], [0, 60]],
    "200 x 200 m": [[0, 0], [200, 0], [200, 200], [0, 200]],
}
"""The areas of the draws, by north and east."""


def test_the_cells_of_a_comparison_are_those_that_a_stated_seed_draws() -> None:
    study = load_study(SHIPPED / "rules.yaml").study
    chance = Random(20261128)
    drawn = dict[tuple[str, int, int], None]()
    while len(drawn) < 8:
        drawn[chance.choice(list(AREAS_M)), chance.choice((8, 12, 20)), chance.choice((2, 4))] = None
    decided = "area.polygon_m", "fleet.count", "apad.docks", "mission.batch"
    assert [(name, [cell[key] for key in decided]) for name, cell in study.cells.items()] == [
        (f"{area}, {amussels} aMussels, {docks} docks", [AREAS_M[area], amussels, docks, docks])
        for area, amussels, docks in drawn
    ]


def test_several_processes_fly_what_one_flies_and_one_that_is_killed_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    study = plan()
    started: list[runner.Worker] = []
    order = runner._order
    monkeypatch.setattr(
        runner, "_order", lambda process, block: (started.append(process), order(process, block))[1]
    )

    def kill_a_worker(missions: int) -> None:
        if missions and len({process.pid for process in started}) == 2:
            for process in started[:2]:
                os.kill(process.pid, signal.SIGKILL)

    with pytest.raises(StudyFailed, match="a worker ended with status -9"):
        fly_study(with_seeds(study, 12), tmp_path / "two", 2, kill_a_worker)
    assert all(process.poll() is not None for process in started)
    monkeypatch.undo()
    assert fly_study(study, tmp_path / "two", 2) == fly_study(study, tmp_path / "one", 1)


@pytest.mark.parametrize("share", [0.0, 0.5])
def test_one_that_is_killed_while_it_answers_is_told(tmp_path: Path, share: float) -> None:
    answer = io.BytesIO()
    runner.send(answer, {"rows": [{"seed": it} for it in range(100)]})
    whole = answer.getvalue()
    (tmp_path / "torn").write_bytes(whole[: int(share * len(whole))])
    dies = ["sh", "-c", f"cat {tmp_path}/torn; kill -9 $$"]
    with (
        subprocess.Popen(dies, stdout=subprocess.PIPE) as worker,
        pytest.raises(StudyFailed, match="a worker ended with status -9"),
    ):
        runner._answer(worker)


@given(workers=st.integers(1, 4), turns=st.lists(st.integers(0, 3), max_size=40))
def test_each_worker_goes_on_with_its_seed_as_long_as_it_has_blocks(workers: int, turns: list[int]) -> None:
    waiting = {seed: [(setting, seed) for setting in range(3)] for seed in range(5)}
    last: dict[int, tuple[int, int]] = {}
    taken = []
    for worker in [it % workers for it in turns] + [0] * 15:
        if not waiting:
            break
        own = last.get(worker)
        untouched = {seed for seed, blocks in waiting.items() if len(blocks) == 3}
        may = {own[1]} if own is not None and own[1] in waiting else untouched or set(waiting)
        last[worker] = runner._take(waiting, own)
        taken.append(last[worker])
        assert last[worker][1] in may
    assert sorted(taken) == [(setting, seed) for setting in range(3) for seed in range(5)]


@pytest.mark.parametrize("workers", [1, 2])
def test_a_strategy_that_fails_ends_the_study_with_its_reason(tmp_path: Path, workers: int) -> None:
    with pytest.raises(
        StudyFailed, match=r"exact plans are for 6 aMussels, not for .* \(exact in pool, .* seed \d\)"
    ):
        fly_study(plan(strategies=["cautious", "exact"]), tmp_path, workers)


def test_a_study_of_other_firmware_says_in_a_line_that_it_flies_ours(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    data = resolve(load(POOL_FILE))
    data["fleet"] |= {"firmware": [{"executable": "/bin/true"}], "hosting": "processes"}
    (tmp_path / "pool.yaml").write_text(json.dumps(data))
    file = tmp_path / "study.yaml"
    short = {"scenarios": [str(tmp_path / "pool.yaml")], "strategies": ["cautious"], "seeds": 1}
    file.write_text(json.dumps({**STUDY, **short}))
    arguments = ["--workers", "1", "--out", str(tmp_path / "out"), "--json"]
    assert main(["study", str(file), *arguments]) == 0
    assert "a study flies our firmware in place of fleet.firmware\n" in capsys.readouterr().err


def test_the_command_writes_a_row_for_each_mission_and_a_report(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    from pyarrow import parquet

    file = tmp_path / "study.yaml"
    file.write_text(json.dumps(STUDY))
    out = tmp_path / "out"
    assert main(["study", str(file), "--seeds", "3", "--workers", "1", "--out", str(out), "--json"]) == 0
    result = json.loads(capsys.readouterr().out)
    (setting,) = result["settings"]
    assert setting["ranking"] == [it["strategy"] for it in setting["strategies"]]
    table = parquet.read_table(out / "results.parquet").to_pylist()
    assert [(row["strategy"], row["seed"]) for row in table] == [
        (strategy, seed) for seed in (1, 2, 3) for strategy in ("cautious", "greedy")
    ]
    assert set(COLUMNS) <= table[0].keys()
    for standing in setting["strategies"]:
        own = [row["metres"] for row in table if row["strategy"] == standing["strategy"]]
        assert standing["columns"]["metres"]["mean"] == pytest.approx(sum(own) / 3)
    page = (out / "report.html").read_text()
    # Every axis of the three drawings, and the dashed bound, has its name beside it: words are comments beside their paths.
    samples, submerged, missions = (re.findall("<!-- (.*?) -->", it) for it in page.split("<svg")[1:])
    assert "samples taken" in samples and {"submerged %", "no strategy exceeds"} <= set(submerged)
    assert {"way planned m", "uptime %", "cautious", "greedy"} <= set(
        missions
    ) and "No strategy exceeds" in page
    # A row for each figure, by a name of its own; a column for each strategy.
    tables = re.findall("<table>(.*?)</table>", page, re.DOTALL)
    names, of_differences = (re.findall("<tr><td>([^<]*)</td>", it) for it in tables)
    assert len(set(names)) == len(names) == len(COLUMNS) and names == of_differences
    columns = [re.findall("<th>([^<]*)</th>", it) for it in tables]
    assert columns == [["", *setting["ranking"]], ["", "greedy"]]
    assert main(["study", str(file), "--seeds", "3", "--workers", "1", "--out", str(out)]) == 0
    shown = capsys.readouterr().out
    headings = "lost", "samples taken", "longest gap h", "submerged %", "way planned m"
    assert re.search(".*".join(f"\n {it}" for it in headings), shown, re.DOTALL)
    taken = {
        name: np.array([row["samples_taken"] for row in table if row["strategy"] == name])
        for name in ("cautious", "greedy")
    }
    less = taken["greedy"] - taken["cautious"]
    low, high = scipy.stats.t.interval(0.95, 2, less.mean(), scipy.stats.sem(less))
    side = "above it" if low > 0 else "below it" if high < 0 else "not clearly different"
    verdict = re.search(rf"^samples taken, against cautious: {side}: greedy (\S+) ± ", shown, re.MULTILINE)
    assert verdict and float(verdict[1]) == pytest.approx(less.mean(), abs=0.5)
    assert f"<b>samples taken, against cautious: {side}: greedy {verdict[1]}" in page


OF_A_LAB = (
    "from apad_bridge.planning.strategies.paper_strategies import Greedy\n\n\nclass Last(Greedy):\n    pass\n"
)


def assert_flown_as_greedy(study: StudyPlan, out: Path) -> None:
    """By two processes, which import its strategy as this one does."""
    by_name: dict[str, list[dict[str, Any]]] = {it: [] for it in study.strategies}
    for row in fly_study(study, out, 2):
        by_name[row["strategy"]].append({**row, "strategy": ""})
    ours, greedy = by_name.values()
    assert ours == greedy and len(ours) == 2


def test_a_strategy_of_a_package_is_flown_by_its_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    info = tmp_path / "lab-1.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: lab\nVersion: 1\n")
    (info / "entry_points.txt").write_text("[musselbed.strategies]\nlast = lab:Last\n")
    (tmp_path / "lab.py").write_text(OF_A_LAB)
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    assert_flown_as_greedy(plan(strategies=["last", "greedy"], seeds=2), tmp_path / "out")


def test_a_strategy_of_a_file_is_flown_and_goes_on_only_as_it_was(tmp_path: Path) -> None:
    file = tmp_path / "lab.py"
    file.write_text(OF_A_LAB)
    mine = plan_of({**STUDY, "strategies": ["lab.py:Last", "greedy"], "seeds": 2}, "test", tmp_path, Trust())
    assert_flown_as_greedy(mine, tmp_path / "out")
    write_study(mine, tmp_path / "out")
    before = mine.fingerprint
    file.write_text(f"{OF_A_LAB}# another rule\n")
    assert mine.fingerprint != before  # the copy of the study has the rule that flew
    assert load_study(tmp_path / "out" / STUDY_FILE, trust=Trust()).fingerprint == before
    with pytest.raises(ScenarioError, match=r"mission.collection: strategy lab.py:Last is code in a file"):
        load_study(tmp_path / "out" / STUDY_FILE)


def test_no_figure_is_nan(tmp_path: Path) -> None:
    (row,) = fly_study(plan(strategies=["none"], seeds=1), tmp_path, 1)
    assert not [key for key, value in row.items() if isinstance(value, float) and math.isnan(value)]
