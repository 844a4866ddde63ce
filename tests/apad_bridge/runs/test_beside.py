"""The watch of a run's own master: it tells that the master stands still, and answers again, but not that it has ended."""

from __future__ import annotations

import queue
from pathlib import Path

import pytest
from killing import standing_still

from apad_bridge.doctor import network
from apad_bridge.ros.system.master import start_master
from apad_bridge.runs.beside import watched_master, why_no_answer

PATIENCE_S = 180.0


def test_a_master_that_stands_still_is_told_once_and_one_that_ended_is_the_run_s_end(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(network, "TIMEOUT_S", 0.2)
    master = start_master(tmp_path / "ros", PATIENCE_S)
    told: queue.Queue[str] = queue.Queue()
    try:
        with watched_master(master.uri, tmp_path, told.put, period_s=0.01):
            with standing_still(master.pid):
                still = told.get(timeout=PATIENCE_S)
            again = told.get(timeout=PATIENCE_S)
        master.stop()
        assert why_no_answer(master.uri) is None
    finally:
        master.stop()
    assert still.startswith("the run's own ROS master stands still, so no ROS tool finds the run: getPid at ")
    assert again == "the run's own ROS master answers again"
    assert told.empty()
