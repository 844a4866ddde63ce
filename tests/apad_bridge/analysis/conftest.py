"""Runs that several tests of analyses read, flown once."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml
from scenario_files import POOL_FILE, SCENARIO_FILES, WHOLE_FILE

from apad_bridge.commands.main import main
from apad_bridge.records.run_directory import RunDirectory


def flown(source: Path, folder: Path, seconds: int, threshold: float) -> RunDirectory:
    """A run of a test's scenario in one process; below `threshold` an aMussel is collected."""
    data = yaml.safe_load(source.read_text())
    data["duration_s"] = seconds
    data["fleet"].update(start=str(SCENARIO_FILES / "pool.csv"), hosting="one_process")
    data["mission"]["pool_threshold"] = threshold
    scenario, run = folder / source.name, folder / "run"
    scenario.write_text(yaml.safe_dump(data))
    assert main(["run", str(scenario), "--time", "asap", "--out", str(run), "--json"]) == 0
    return RunDirectory(run)


@pytest.fixture(scope="session")
def pool_run(tmp_path_factory: pytest.TempPathFactory) -> RunDirectory:
    """Ten minutes of the pool at theta 30: four aMussels are docked and charge."""
    return flown(POOL_FILE, tmp_path_factory.mktemp("pool"), 600, 0.8)


@pytest.fixture(scope="session")
def whole_run(tmp_path_factory: pytest.TempPathFactory) -> RunDirectory:
    """The same with whole boards, which switch their modules."""
    return flown(WHOLE_FILE, tmp_path_factory.mktemp("whole"), 600, 0.95)
