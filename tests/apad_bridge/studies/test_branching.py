"""Branches of a run: with the same rules a branch is the run itself, and other rules count from the moment on."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from shutil import copytree
from typing import Any
from unittest.mock import Mock

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scenario_files import POOL_FILE

from apad_bridge.commands.main import main
from apad_bridge.records.run_directory import RunDirectory
from apad_bridge.runs.supervisor_lock import supervising
from apad_bridge.scenario.errors import UserError
from apad_bridge.scenario.loader import load, resolve
from apad_bridge.scenario.run_options import RunOptions, TimeSource
from apad_bridge.studies.branching import Branches, Turn, branch

DURATION_S = 900


def flown(folder: Path, **changes: Any) -> Path:
    """A run in virtual time whose first services end before its half."""
    data = resolve(load(POOL_FILE))
    data["duration_s"], data["fleet"]["start"] = float(DURATION_S), {"charge": [0.6, 1.0]}
    data.update(changes)
    (folder / "scenario.yaml").write_text(json.dumps(data))
    arguments = ["--time", "asap", "--hosting", "one_process", "--json", "--out", str(folder / "run")]
    assert main(["run", str(folder / "scenario.yaml"), *arguments]) == 0
    return folder / "run"


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return flown(tmp_path_factory.mktemp("flown"))


def as_if_by_a_clock(run: Path) -> None:
    """The run's options say that it was flown by a clock, so that only its records count."""
    replace(RunOptions.load(run), time=TimeSource.WALL).save(run)


@settings(max_examples=3, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(at_ms=st.integers(1, DURATION_S * 1000 - 1))
def test_with_the_same_rules_a_branch_is_the_run_to_the_last_figure(run: Path, at_ms: int) -> None:
    found = branch(run, Turn(at_ms, {"collection": "cautious", "pool_threshold": 0.8}))
    assert found.is_exact and found.flown == found.unchanged == found.changed


def test_other_rules_count_from_the_moment_on(run: Path) -> None:
    early, late = (branch(run, Turn(at_ms, {"collection": "none"})) for at_ms in (1000, 899_000))
    assert early.flown["services"] and early.changed["services"] == 0 and early.changed["planned_m"] == 0
    assert late.changed == late.unchanged
    threshold = branch(run, Turn(1000, {"pool_threshold": 0.6}))
    assert threshold.changed["planned_m"] < threshold.unchanged["planned_m"]


def test_a_lost_apad_keeps_what_it_has_docked_and_serves_nobody_any_more(run: Path) -> None:
    journal = [json.loads(line) for line in RunDirectory(run).journal.read_text().splitlines()]
    docked_ms = next(line["t"] for line in journal if line["kind"] == "dock")
    name = load(run / "scenario.yaml").apad.name
    found = branch(run, Turn(docked_ms + 1000, lost_apad=name))
    assert found.changed["services"] == 0 < found.unchanged["services"]
    assert found.changed["uptime_paper.min"] < 50  # the one that it keeps docked


def test_from_records_a_branch_goes_on_as_the_run_did(run: Path, tmp_path: Path) -> None:
    """A wait on the way of the aPad apart, which stands where it was seen last."""
    run = Path(copytree(run, tmp_path / "run"))
    as_if_by_a_clock(run)
    for at_ms in (150_000, 300_000):
        found = branch(run, Turn(at_ms, {"collection": "none"}))
        bounds = {
            "uptime_paper.mean": {"abs": 0.7},
            "uptime_paper.min": {"abs": 4},
            "planned_m": {"rel": 0.1},
        }
        as_flown = {name: pytest.approx(found.flown[name], **within) for name, within in bounds.items()}
        assert not found.is_exact and {name: found.unchanged[name] for name in bounds} == as_flown
        assert found.changed["planned_m"] < found.unchanged["planned_m"]


def test_a_run_that_a_crash_ended_branches_without_figures_as_flown(run: Path, tmp_path: Path) -> None:
    whole = branch(run, Turn(150_000, {"collection": "none"}))
    run = Path(copytree(run, tmp_path / "run"))
    directory = RunDirectory(run)
    directory.summary.unlink()
    lines = directory.journal.read_text().splitlines(keepends=True)
    directory.journal.write_text("".join(it for it in lines if json.loads(it)["t"] <= 400_000))
    found = branch(run, Turn(150_000, {"collection": "none"}))
    assert set(found.flown.values()) == {None}
    assert (found.unchanged, found.changed) == (whole.unchanged, whole.changed)
    last_s = json.loads(directory.journal.read_text().splitlines()[-1])["t"] / 1000
    with pytest.raises(UserError, match=f"--at 500 s: the run lasted {last_s:g} s"):
        branch(run, Turn(500_000, {"collection": "none"}))
    with supervising(run), pytest.raises(UserError, match="the run flies still: musselbed abort "):
        branch(run, Turn(150_000, {"collection": "none"}))


def test_a_run_in_virtual_time_that_does_not_repeat_goes_on_from_its_records(
    run: Path, tmp_path: Path
) -> None:
    run = Path(copytree(run, tmp_path / "run"))
    journal = RunDirectory(run).journal
    lines = [json.loads(line) for line in journal.read_text().splitlines()]
    moved = next(line for line in lines if line["kind"] == "stimulus" and line["t"] > 50_000)
    moved["wire"][1] += 10_000  # the dock carried it a centimetre farther
    journal.write_text("".join(json.dumps(line) + "\n" for line in lines))
    assert branch(run, Turn(600_000, {"collection": "none"})).is_exact is False


@pytest.mark.parametrize(
    ("turn", "message"),
    [
        (Turn(DURATION_S * 1000), "--at 900 s: the run lasted 900 s"),
        (Turn(1000, {"collection": "gready"}), "unknown strategy 'gready'"),
        (Turn(1000, {"pool_threshold": 2.0}), "pool_threshold"),
        (Turn(1000, {"speed_m_s": 2.0}), "--set speed_m_s: what can change in flight is collection"),
        (Turn(1000, lost_apad="apad9"), "--lose-apad apad9: the run's aPads are apad1"),
    ],
)
def test_a_mistake_is_one_line(run: Path, turn: Turn, message: str) -> None:
    with pytest.raises(UserError, match=message) as raised:
        branch(run, turn)
    assert "\n" not in str(raised.value)


def test_a_branch_of_a_run_with_other_firmware_says_in_a_line_that_it_flies_ours(
    run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    copytree(run, tmp_path / "run")
    flown_with = RunDirectory(tmp_path / "run").scenario
    data = resolve(load(flown_with))
    data["fleet"] |= {"firmware": [{"executable": "/bin/true"}], "hosting": "processes"}
    flown_with.write_text(json.dumps(data))
    arguments = ["--at", "860", "--strategy", "njnp", "--json"]
    capsys.readouterr()
    assert main(["branch", str(tmp_path / "run"), *arguments]) == 0
    shown = capsys.readouterr()
    assert "a branch flies our firmware in place of fleet.firmware\n" in shown.err
    assert json.loads(shown.out)["has_our_firmware"] is True
    assert main(["branch", str(run), *arguments]) == 0
    assert "our firmware" not in capsys.readouterr().err


def test_the_command_reads_a_time_as_people_write_it(
    run: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    asked = Mock(return_value=Branches({}, {}, {}, True))
    monkeypatch.setattr("apad_bridge.studies.branching.branch", asked)
    for time in ("14:20", "860", "0:14:20"):
        assert (
            main(["branch", str(run), "--at", time, "--set", "charge_to=0.8", "--strategy", "njnp", "--json"])
            == 0
        )
    turn = Turn(860_000, {"charge_to": 0.8, "collection": "njnp"})
    assert [it.args[1] for it in asked.call_args_list] == [turn] * 3
    capsys.readouterr()
    assert main(["branch", str(run), "--at", "860"]) == 2
    assert "nothing changes: give --strategy, --set or --lose-apad" in capsys.readouterr().err
