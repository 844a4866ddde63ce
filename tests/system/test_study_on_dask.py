"""A study on a real Dask scheduler with two workers, of which one is killed: the rows are those of this machine."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from functools import partial
from pathlib import Path

import pytest
from programs import ROOT, Begin
from scenario_files import POOL_FILE

from apad_bridge.studies.dask_cluster import fly_on_dask, fly_there
from apad_bridge.studies.runner import StudyFailed, fly_study
from apad_bridge.studies.specification import StudyPlan, plan_of

pytestmark = [pytest.mark.system, pytest.mark.filterwarnings("ignore")]  # Dask's own warnings

READY = "Scheduler at:"


def told(process: subprocess.Popen[str], words: str) -> str:
    """The first line of a process's log with these words."""
    assert process.stderr is not None
    for line in process.stderr:
        if words in line:
            return line
    raise AssertionError(f"it ended without {words!r}")


@pytest.fixture
def cluster(tmp_path: Path, begin: Begin) -> tuple[str, list[subprocess.Popen[str]]]:
    def started(module: str, *arguments: object) -> subprocess.Popen[str]:
        command = (sys.executable, "-m", f"distributed.cli.{module}", *arguments)
        environment = {**os.environ, "PYTHONPATH": str(ROOT)}
        return begin(*command, cwd=tmp_path, env=environment, stdout=None, ends_by=signal.SIGKILL)

    scheduler = started("dask_scheduler", "--host", "127.0.0.1", "--port", 0, "--no-dashboard")
    address = told(scheduler, READY).split()[-1]
    options = ("--nthreads", 1, "--no-nanny", "--no-dashboard")
    workers = [started("dask_worker", address, *options) for _ in range(2)]
    assert all(told(worker, "Registered to:") for worker in workers)
    return address, workers


def study() -> StudyPlan:
    return plan_of(
        {
            "name": "short",
            "scenarios": [str(POOL_FILE)],
            "strategies": ["cautious", "greedy"],
            "seeds": 6,
            "parameters": {"duration_s": [300.0]},
        },
        "test",
        Path("/"),
    )


def test_a_worker_that_is_killed_loses_nothing(
    tmp_path: Path, cluster: tuple[str, list[subprocess.Popen[str]]]
) -> None:
    address, workers = cluster

    def kill_one(missions: int) -> None:
        if missions and workers[0].poll() is None:
            workers[0].send_signal(signal.SIGKILL)
            workers[0].wait()

    rows = fly_study(study(), tmp_path / "there", partial(fly_on_dask, address=address), kill_one)
    assert workers[0].poll() == -signal.SIGKILL and workers[1].poll() is None
    assert rows == fly_study(study(), tmp_path / "here", 1)


def test_a_worker_with_another_version_is_named() -> None:
    with pytest.raises(StudyFailed, match=r"a worker of the cluster has musselbed .*, another than here"):
        fly_there(study(), "of another version", (0, 1))


def test_no_scheduler_is_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("apad_bridge.studies.dask_cluster._CONNECT_S", 1)
    with pytest.raises(StudyFailed, match=r"--dask tcp://127.0.0.1:9: no scheduler answers there"):
        fly_study(study(), tmp_path, partial(fly_on_dask, address="tcp://127.0.0.1:9"))
