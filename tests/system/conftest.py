"""Every run that a system test flies obeys the laws of `musselbed check`, whatever the test did to it.

A master, the tools' shell on it, and programs that end with the test.
"""

from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest
from browsers import chromium
from programs import Begin, begun
from selenium import webdriver

from apad_bridge.analysis.invariants import check_run
from apad_bridge.records.run_directory import RunDirectory, RunDirectoryError
from apad_bridge.ros.system.master import Master, loopback_environment, start_master
from apad_bridge.ros.types.messages import generated_folder
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


@pytest.fixture
def begin() -> Iterator[Begin]:
    """Starts a program as `begun` does; what still runs is ended after the test, the last one first."""
    with ExitStack() as stack:

        def start(*words: object, **options: Any) -> Any:
            return stack.enter_context(begun(*words, **options))

        yield start


@pytest.fixture(scope="module")
def browser() -> Iterator[webdriver.Chrome]:
    with chromium() as driver:
        yield driver


@pytest.fixture
def master(tmp_path: Path) -> Iterator[Master]:
    running = start_master(tmp_path / "ros", timeout_s=120, orphan_s=60)
    yield running
    running.stop()


@pytest.fixture
def shell(tmp_path: Path, master: Master) -> dict[str, str]:
    """The environment of ROS' own tools on the master, with our messages."""
    environment = loopback_environment(tmp_path / "ros", master.uri)
    return environment | dict.fromkeys(("PYTHONPATH", "ROS_PACKAGE_PATH"), str(generated_folder()))
