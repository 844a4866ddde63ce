"""Limits of the machine, each with the number that decides on both sides of it."""

from __future__ import annotations

import os
import resource
from pathlib import Path

import pytest

from apad_bridge.doctor.finding import CheckStatus
from apad_bridge.doctor.machine import (
    check_disk,
    check_loopback,
    check_memory,
    check_open_files,
    check_processes,
    check_ros_log,
)


def test_a_file_for_each_agent_and_some_of_our_own() -> None:
    few = check_open_files(1000, hard=1024)
    assert few.status is CheckStatus.FAIL
    assert few.mend == "ulimit -Hn 1256 (as root), or --agents 768"
    assert check_open_files(768, hard=1024).status is CheckStatus.OK
    assert check_open_files(20000, hard=resource.RLIM_INFINITY).status is CheckStatus.OK


def test_a_process_for_each_agent() -> None:
    few = check_processes(1000, hard=500, threads_max=100_000)
    assert few.status is CheckStatus.FAIL and "RLIMIT_NPROC is 500" in few.found
    assert check_processes(100, hard=500, threads_max=100_000).status is CheckStatus.OK
    assert check_processes(1000, hard=100_000, threads_max=900).found.startswith("kernel.threads-max is 900")


def test_memory_for_each_agent_or_how_to_do_with_less() -> None:
    assert check_memory(1000, free_mb=2400, merges=False).status is CheckStatus.OK
    short = check_memory(1000, free_mb=2200, merges=False)
    assert short.status is CheckStatus.FAIL
    assert short.mend is not None and "echo 1 > /sys/kernel/mm/ksm/run" in short.mend
    assert check_memory(1000, free_mb=1300, merges=True).status is CheckStatus.OK
    assert check_memory(1000, free_mb=1100, merges=True).status is CheckStatus.FAIL


@pytest.mark.parametrize(("megabytes", "status"), [(99, "FAIL"), (100, "WARN"), (1023, "WARN"), (1024, "OK")])
def test_room_on_the_disk(tmp_path: Path, megabytes: int, status: str) -> None:
    assert check_disk(tmp_path, free=megabytes << 20).status == status


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write anywhere")
def test_a_folder_that_cannot_be_written_to(tmp_path: Path) -> None:
    tmp_path.chmod(0o500)
    assert check_disk(tmp_path, free=10**12).status is CheckStatus.FAIL


def test_the_loopback_of_this_machine_works() -> None:
    (finding,) = check_loopback()
    assert finding.status is CheckStatus.OK


def test_rospy_can_write_its_log(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ROS_LOG_DIR", str(tmp_path / "log"))
    assert check_ros_log().status is CheckStatus.OK
    (tmp_path / "log").touch()
    assert check_ros_log().status is CheckStatus.FAIL
