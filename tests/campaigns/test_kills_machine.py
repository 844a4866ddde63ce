"""A machine that loses its power: its processes end at once, whoever started them, and its memory is empty afterwards."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest
from killing import gone
from kills.flight import ROOT
from kills.machine import DISK, Machine, why_no_machine

pytestmark = [
    pytest.mark.system,
    pytest.mark.skipif(bool(why_no_machine(ROOT)), reason="namespaces are not allowed here"),
]
PATIENCE_S = 180.0
ORPHANS = "(sleep 1000 & (setsid sleep 1001 &)); echo here >/tmp/left; echo here >/dev/shm/left; echo ready; kill -STOP $$"


@pytest.fixture
def disk() -> Iterator[Path]:
    with tempfile.TemporaryDirectory(prefix="musselbed-test-", dir=DISK) as folder:
        yield Path(folder)


def test_all_processes_end_at_once_and_nothing_stays_but_the_disk(disk: Path) -> None:
    (disk / "kept").write_text("on the disk\n")
    machine = Machine(dict(os.environ))
    try:
        machine.start("shell", "sh", "-c", ORPHANS, folder=disk)
        assert not machine.ends("shell", 1.0), "it is stopped"
        found = machine.processes()
        assert {it.split()[0] for it in found.values()} == {"sh", "sleep"} and len(found) == 3
        assert (disk / "shell.out").read_text() == "ready\n"
    finally:
        machine.crash()
    assert all(gone(it) for it in found)

    again = Machine(dict(os.environ))
    try:
        look = "ls /tmp /dev/shm; cat kept; exit 7"
        again.start("look", "sh", "-c", look, folder=disk)
        assert again.ends("look", PATIENCE_S)
    finally:
        again.crash()
    assert again.code("look") == 7
    said = (disk / "look.out").read_text().split("\n")
    assert said[:4] == ["/dev/shm:", "", "/tmp:", "on the disk"]
