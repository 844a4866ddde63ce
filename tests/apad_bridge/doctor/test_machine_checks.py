"""Limits of the machine, each with the number that decides on both sides of it."""

from __future__ import annotations

import os
import resource
from pathlib import Path

import pytest

from apad_bridge.doctor.finding import CheckStatus, Finding
from apad_bridge.doctor.machine import (
    check_disk,
    check_loopback,
    check_memory,
    check_open_files,
    check_processes,
    check_ros_log,
)

UNLIMITED = resource.RLIM_INFINITY
HERE = Path(__file__).parent


@pytest.mark.parametrize(
    ("found", "status", "told"),
    [
        # A file for each agent, and some of our own.
        (check_open_files(1000, hard=1024), "FAIL", "ulimit -Hn 1256 (as root), or --agents 768"),
        (check_open_files(768, hard=1024), "OK", ""),
        (check_open_files(20000, hard=UNLIMITED), "OK", ""),
        # A process for each agent.
        (check_processes(1000, hard=500, threads_max=100_000), "FAIL", "RLIMIT_NPROC is 500"),
        (check_processes(100, hard=500, threads_max=100_000), "OK", ""),
        (check_processes(1000, hard=100_000, threads_max=900), "FAIL", "kernel.threads-max is 900"),
        # Memory for each agent, or how to do with less.
        (check_memory(1000, free_mb=2400, merges=False), "OK", ""),
        (check_memory(1000, free_mb=2200, merges=False), "FAIL", "echo 1 > /sys/kernel/mm/ksm/run"),
        (check_memory(1000, free_mb=1300, merges=True), "OK", ""),
        (check_memory(1000, free_mb=1100, merges=True), "FAIL", ""),
        # Room on the disk.
        *(
            (check_disk(HERE, free=megabytes << 20), status, "")
            for megabytes, status in ((99, "FAIL"), (100, "WARN"), (1023, "WARN"), (1024, "OK"))
        ),
    ],
    ids=str,
)
def test_each_limit_decides_on_both_sides_of_its_number(found: Finding, status: str, told: str) -> None:
    assert found.status == status and told in f"{found.found} {found.mend}"


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
