"""Tests that a run's directory is its own: no file is overwritten, and an unusable directory is reported in one line."""

import hashlib
import json
from dataclasses import replace
from datetime import UTC, datetime

import pytest
from scenario_files import POOL_FILE

from apad_bridge.planning.registry import Trust, collection
from apad_bridge.planning.strategies.paper_strategies import Greedy
from apad_bridge.records.run_directory import RunDirectory, RunDirectoryError
from apad_bridge.scenario.loader import load, with_overrides
from apad_bridge.scenario.schema import FirmwareProgram
from apad_bridge.scenario.starts import read_starts, starts_of

NOW = datetime(2026, 5, 4, 3, 2, 1, tzinfo=UTC)


def test_runs_of_the_same_second_do_not_share_a_directory(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    names = [RunDirectory.create("pool-12", NOW).path.name for _ in range(3)]
    assert names == ["pool-12-20260504T030201Z", "pool-12-20260504T030201Z-2", "pool-12-20260504T030201Z-3"]
    assert all((tmp_path / "runs" / name).is_dir() for name in names)


def test_a_named_directory_may_be_new_or_empty_but_not_used(tmp_path):
    new, empty, used, file = (tmp_path / it for it in ("a/new", "empty", "used", "file"))
    for it in (empty, used):
        it.mkdir()
    (used / "notes.txt").write_text("mine")
    file.write_text("")
    for it in (new, empty):
        assert RunDirectory.create("x", NOW, it).path == it and it.is_dir()
    for it, told in ((used, r"is not empty; .*choose a new directory$"), (file, "File exists; --out wants")):
        with pytest.raises(RunDirectoryError, match=f"{it.name}: {told}"):
            RunDirectory.create("x", NOW, it)
    assert (used / "notes.txt").read_text() == "mine"
    with pytest.raises(RunDirectoryError, match=r"it has no journal\.jsonl"):
        RunDirectory.open(tmp_path)


def test_each_resume_begins_another_bag(tmp_path):
    directory = RunDirectory.create("x", NOW, tmp_path)
    for name in ("run.bag", "run-1.bag", "run-2.bag"):
        assert directory.next_bag == tmp_path / name
        directory.next_bag.write_bytes(b"")
    assert [bag.name for bag in directory.bags] == ["run.bag", "run-1.bag", "run-2.bag"]


@pytest.mark.parametrize(
    ("apads", "kept"), [(["apad1"], ["r.bag"]), (["apad1", "apad2"], ["r-apad1.bag", "r-apad2.bag"])]
)
def test_of_a_run_that_is_not_kept_the_bags_alone_stay(tmp_path, apads, kept):
    whole = RunDirectory.create("x", NOW, tmp_path / "r")
    for name in apads:
        run = whole.of_apad(name, len(apads))
        run.path.mkdir(exist_ok=True)
        run.next_bag.write_text(name)
        run.journal.write_text("{}\n")
    bags = whole.reduced_to_bags(apads)
    assert [it.read_text() for it in bags] == apads
    assert sorted(bags) == sorted(tmp_path.iterdir()) == [tmp_path / name for name in kept]


def test_of_a_run_that_another_supervisor_continued_all_stays(tmp_path):
    run = RunDirectory.create("x", NOW, tmp_path / "r")
    run.next_bag.write_bytes(b"")
    run.next_bag.write_bytes(b"")
    assert run.reduced_to_bags(["apad1"]) == [] and len(run.bags) == 2


def written(scenario, folder):
    """A run's directory with its inputs, and the versions in it."""
    directory = RunDirectory.create(scenario.name, NOW, folder / "run")
    directory.write_inputs(scenario, starts_of(scenario))
    return directory, json.loads(directory.versions.read_text())


def test_the_inputs_make_the_same_run_again(tmp_path):
    scenario = load(POOL_FILE)
    directory, versions = written(scenario, tmp_path)
    again = load(directory.scenario)
    assert (again.board, again.mission, again.seed) == (scenario.board, scenario.mission, scenario.seed)
    assert read_starts(directory.path, scenario.area, scenario.fleet.ids) == starts_of(scenario)
    assert versions["python"].startswith("3.") and versions["rosbags"] and "rospy" in versions
    names = sorted(path.name for path in directory.path.iterdir())
    assert names == ["scenario.yaml", "starts.csv", "versions.json"]


def test_a_run_names_the_hash_of_its_firmware(tmp_path):
    """By `printf 'a board' | sha256sum`."""
    program = tmp_path / "board"
    program.write_bytes(b"a board")
    scenario = load(POOL_FILE)
    flown = (
        FirmwareProgram(executable=str(program), agents=(1,)),
        FirmwareProgram(executable="serial:/dev/ttyUSB0", agents=(2,)),
    )
    _, versions = written(replace(scenario, theta=1, fleet=replace(scenario.fleet, firmware=flown)), tmp_path)
    digest = "2a7d86c59aedf33a1a1d14c01af7ed963baf7f2b6c129437df990cc4d7c28a41"
    assert versions["firmware_files"] == {str(program): digest}


def test_a_run_keeps_the_file_of_its_strategy_and_names_its_hash(tmp_path, monkeypatch):
    file = tmp_path / "mine.py"
    file.write_text(
        "from apad_bridge.planning.strategies.paper_strategies import Greedy\n\n\nclass Mine(Greedy):\n    pass\n"
    )
    digest = hashlib.sha256(file.read_bytes()).hexdigest()
    monkeypatch.chdir(tmp_path)
    directory, versions = written(with_overrides(load(POOL_FILE), strategy="mine.py:Mine"), tmp_path)
    assert versions["strategy_files"] == {"mine.py:Mine": digest}
    file.write_text("class Mine: pass\n")
    moved = directory.path.rename(tmp_path / "moved")
    again = load(moved / "scenario.yaml")
    assert again.mission.collection == f"{moved}/collection/mine.py:Mine"
    assert isinstance(collection(again.mission.collection, trust=Trust()), Greedy)
