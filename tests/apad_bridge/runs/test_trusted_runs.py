"""Runs that this user began here are known; copies, moved ones, altered ones and strangers' are not."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path

import pytest
from scenario_files import POOL_FILE

from agents.hosting.started import PYTHON
from agents.nursery.fleet_file import FLEET_NAME
from agents.nursery.launch import prepare
from apad_bridge.assembly.fleet_parts import fleet_config, initial_states
from apad_bridge.assembly.flight_config import flight_config
from apad_bridge.commands.main import main
from apad_bridge.planning.registry import Trust
from apad_bridge.records.run_directory import RunDirectory
from apad_bridge.runs.nurseries import FOLDER
from apad_bridge.runs.trusted_runs import code_of, is_own, mark
from apad_bridge.scenario.loader import from_data, load, resolve
from apad_bridge.scenario.run_options import APadKind, BenchPart, OnDeath, RunOptions, TimeSource
from apad_bridge.scenario.starts import starts_of

STRATEGY = """\
from pathlib import Path

from apad_bridge.planning.strategies.paper_strategies import Greedy

Path(__file__).with_name("executed").write_text("")


class Mine(Greedy):
    pass
"""
OPTIONS = RunOptions(BenchPart.WHOLE, APadKind.SIM, TimeSource.WALL, 1.0, OnDeath.WAIT)


@pytest.fixture(autouse=True)
def state(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    return tmp_path / "state"


@pytest.fixture
def begun(tmp_path: Path) -> RunDirectory:
    """A run with a strategy and firmware of files, as its command leaves it before the flight."""
    (tmp_path / "mine.py").write_text(STRATEGY)
    (tmp_path / "board.py").write_text("")
    return begin(tmp_path, tmp_path / "run")


def begin(folder: Path, out: Path, **firmware: str) -> RunDirectory:
    data = resolve(load(POOL_FILE))
    data["mission"]["collection"] = f"{folder}/mine.py:Mine"
    program = {"executable": PYTHON[0], "arguments": [str(folder / "board.py")], **firmware}
    data["fleet"] |= {"firmware": [program], "hosting": "processes"}
    scenario = from_data(data, "test")
    directory = RunDirectory.create(scenario.name, datetime.now(UTC), out)
    directory.write_inputs(scenario, starts_of(scenario))
    directory.journal.write_text('{"t": 0, "kind": "run", "format": 2}\n')
    OPTIONS.save(directory.path)
    mark(directory)
    return directory


def prepare_fleet(directory: RunDirectory) -> None:
    scenario = load(directory.scenario)
    (directory.path / FOLDER).mkdir()
    states = initial_states(scenario, starts_of(scenario))
    prepare(directory.path / FOLDER, fleet_config(flight_config(scenario, Trust())), states)


def test_a_run_that_was_begun_here_is_known_and_its_code_is_named(begun: RunDirectory) -> None:
    assert is_own(begun)
    prepare_fleet(begun)
    assert is_own(begun)
    assert code_of(begun) == ["mine.py:Mine", f"{PYTHON[0]} {begun.path.parent}/board.py"]


def altered(file: str) -> Callable[[RunDirectory], Path]:
    def alter(run: RunDirectory) -> Path:
        (run.path / file).write_text((run.path / file).read_text() + "# altered\n")
        return run.path

    return alter


def unmarked(run: RunDirectory) -> Path:
    shutil.rmtree(run.path.parent / "state")
    return run.path


@pytest.mark.parametrize(
    "change",
    [
        pytest.param(lambda run: shutil.copytree(run.path, run.path.with_name("copy")), id="a copy"),
        pytest.param(lambda run: run.path.rename(run.path.with_name("moved")), id="a moved one"),
        pytest.param(unmarked, id="one without a mark"),
        *(pytest.param(altered(it), id=it) for it in ("scenario.yaml", "collection/mine.py", "../board.py")),
    ],
)
def test_what_was_changed_is_not_known(begun: RunDirectory, change: Callable[[RunDirectory], Path]) -> None:
    assert is_own(begun)
    assert not is_own(RunDirectory(change(begun)))


def test_a_prepared_fleet_with_other_firmware_is_not(begun: RunDirectory, tmp_path: Path) -> None:
    (tmp_path / "other").mkdir()
    shutil.copy(tmp_path / "mine.py", tmp_path / "other")
    another = begin(tmp_path / "other", tmp_path / "another", executable="/bin/false")
    prepare_fleet(another)
    prepare_fleet(begun)
    shutil.copy(another.path / FOLDER / FLEET_NAME, begun.path / FOLDER)
    assert not is_own(begun) and code_of(begun)[-1] == f"{FOLDER}/{FLEET_NAME}"


def test_a_fleet_of_another_version_is_refused_in_a_line(
    begun: RunDirectory, capsys: pytest.CaptureFixture[str]
) -> None:
    prepare_fleet(begun)
    (begun.path / FOLDER / FLEET_NAME).write_bytes(b"the fleet of a former version")
    assert not is_own(begun)
    assert main(["resume", str(begun.path)]) == 2
    told = capsys.readouterr().err
    assert f"{FLEET_NAME} was written by another version" in told and len(told.splitlines()) == 1


def test_marks_are_the_users_alone_and_those_of_runs_that_are_gone_go(
    begun: RunDirectory, state: Path, tmp_path: Path
) -> None:
    folder = state / "musselbed" / "runs"
    assert folder.stat().st_mode & 0o077 == 0
    (first,) = folder.iterdir()
    (folder / "damaged.json").write_text("{")
    assert json.loads(first.read_text())["run"] == str(begun.path)
    shutil.rmtree(begun.path)
    begin(tmp_path, tmp_path / "next")
    (second,) = folder.iterdir()
    assert second != first


def test_a_run_without_code_has_no_mark(tmp_path: Path, state: Path) -> None:
    scenario = load(POOL_FILE)
    directory = RunDirectory.create(scenario.name, datetime.now(UTC), tmp_path / "plain")
    directory.write_inputs(scenario, starts_of(scenario))
    mark(directory)
    assert code_of(directory) == [] and not state.exists()


def test_a_strangers_run_is_resumed_with_trust_alone(
    begun: RunDirectory, capsys: pytest.CaptureFixture[str]
) -> None:
    shutil.copytree(begun.path, copy := begun.path.with_name("copy"))
    assert main(["resume", str(copy)]) == 2
    told = capsys.readouterr().err
    assert "mine.py:Mine" in told and "add --trust" in told and len(told.splitlines()) == 1
    assert not (copy / "collection" / "executed").exists()
