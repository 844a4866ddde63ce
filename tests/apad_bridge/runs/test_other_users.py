"""What other users of the machine can reach of a run: nothing, whatever the umask is."""

from __future__ import annotations

import os
import socket
import stat
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import pytest
from scenario_files import POOL_FILE

from agents.nursery import protocol
from apad_bridge.assembly.flight_config import flight_config
from apad_bridge.records.run_directory import RunDirectory
from apad_bridge.runs.flying import open_fleet
from apad_bridge.scenario.loader import load
from apad_bridge.scenario.starts import starts_of

CONNECTING = """
import os, socket, sys
os.setuid(65534)
mine, other = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
with socket.socket(fileno=int(sys.argv[1])) as parent:
    socket.send_fds(parent, [b"."], [other.fileno()])
"""


@pytest.fixture
def umask_of_none() -> Iterator[None]:
    before = os.umask(0)
    yield
    os.umask(before)


def mode(path: Path) -> int:
    return stat.S_IMODE(path.stat().st_mode)


@pytest.mark.usefixtures("umask_of_none")
def test_a_run_is_its_users_alone_whatever_the_umask_is(tmp_path: Path) -> None:
    directory = RunDirectory.create("pool-12", datetime(2026, 5, 4, tzinfo=UTC), tmp_path / "run")
    scenario = load(POOL_FILE)
    scenario = replace(scenario, fleet=replace(scenario.fleet, count=1))
    fleet = open_fleet(flight_config(scenario), starts_of(scenario), directory.path)
    try:
        assert mode(directory.path) == mode(directory.path / "fleet") == 0o700
        assert mode(directory.path / "fleet" / "nursery.sock") == 0o600
        assert os.umask(0) == 0  # as it was
        assert "mode 0700" in (Path(__file__).parents[3] / "docs" / "records.md").read_text()
    finally:
        fleet.close()


def test_a_directory_that_is_there_keeps_its_mode(tmp_path: Path) -> None:
    (tmp_path / "run").mkdir(mode=0o750)
    RunDirectory.create("pool-12", datetime(2026, 5, 4, tzinfo=UTC), tmp_path / "run")
    assert mode(tmp_path / "run") == 0o750


def test_our_own_processes_are_ours() -> None:
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    with ours, theirs:
        assert protocol.is_of_our_user(ours)


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can be another user")
def test_a_process_of_another_user_is_not() -> None:
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    with ours, theirs:
        subprocess.run(
            [sys.executable, "-S", "-c", CONNECTING, str(theirs.fileno())],
            pass_fds=[theirs.fileno()],
            check=True,
            timeout=60,
        )
        _, (descriptor,), _, _ = socket.recv_fds(ours, 1, 1)
    with socket.socket(fileno=descriptor) as link:
        assert not protocol.is_of_our_user(link)
