"""Every run that a system test flies obeys the laws of `musselbed check`, whatever the test did to it."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from apad_bridge.analysis.invariants import check_run
from apad_bridge.records.run_directory import RunDirectory, RunDirectoryError
from apad_bridge.scenario.errors import ScenarioError


@pytest.fixture(autouse=True)
def laws_hold(tmp_path: Path) -> Iterator[None]:
    yield
    for journal in sorted(tmp_path.rglob("journal.jsonl")):
        try:
            broken = check_run(RunDirectory.open(journal.parent))
        except (RunDirectoryError, ScenarioError, OSError):
            continue  # the test damaged it, or took a part of it away
        assert broken == [], journal
