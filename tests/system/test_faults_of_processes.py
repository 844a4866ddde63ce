"""The faults that need a process of its own for each aMussel, in one flight of real processes: all of them heal."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest
import yaml
from journals import lines_in

from apad_bridge.analysis.energy.energy import energy_of
from apad_bridge.analysis.invariants import check_run
from apad_bridge.records.run_directory import RunDirectory

pytestmark = pytest.mark.system

ROOT = Path(__file__).parents[2]
MUSSELBED = [sys.executable, "-m", "apad_bridge.commands.main"]
PATIENCE_S = 240.0
KILLED, STOPPED, LIMITED = 1, 2, 3


def test_processes_that_are_killed_stopped_or_short_of_memory_come_back(tmp_path: Path) -> None:
    data = yaml.safe_load((ROOT / "launch_scripts/scenarios/pool-12.yaml").read_text())
    data["duration_s"] = 240
    data["fleet"] |= {"count": 4, "start": {"charge": [0.9, 1.0]}}
    data["faults"] = {
        "at": [
            {"fault": "killed", "id": KILLED, "at_s": 30},
            {"fault": "stopped", "id": STOPPED, "at_s": 60},
            # A megabyte is far less than the process has: it ends as soon as it needs another page.
            {"fault": "memory_limit", "id": LIMITED, "at_s": 90, "for_s": 60, "value": 1},
            {"fault": "clock_jump", "id": LIMITED, "at_s": 120, "value": 5},
        ]
    }
    (tmp_path / "faulty.yaml").write_text(yaml.safe_dump(data))
    out = tmp_path / "run"
    command = [
        *MUSSELBED,
        "run",
        str(tmp_path / "faulty.yaml"),
        "--time",
        "asap",
        "--out",
        str(out),
        "--json",
    ]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=PATIENCE_S)
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["amussels_lost"] == 0

    lines = lines_in(RunDirectory(out).journal)
    faults = {(it["fault"], it["id"]): it for it in lines if it["kind"] == "fault"}
    assert all("refused" not in it for it in faults.values())
    deaths = {(it["id"], it["cause"]): it for it in lines if it["kind"] == "died"}
    # A process that a busy machine lets stand still for 2 s dies by the watchdog, too.
    assert "SIGKILL" in deaths[KILLED, "BROWN_OUT"]["reason"]
    assert "no answer within 2 s" in deaths[STOPPED, "WATCHDOG"]["reason"]
    assert all(it["gave_up"] is None for it in deaths.values())
    assert "Traceback" not in (out / "fleet" / "nursery.log").read_text()
    assert [it["t"] for it in lines if it["kind"] == "fault_over" and it["fault"] == "memory_limit"] == [
        150_000
    ]
    heard = {it["id"]: it["heard"] for it in lines if it["kind"] == "belief"}
    # Each sends again after its fault, and to the end.
    assert {agent_id: heard_ms > 150_000 for agent_id, heard_ms in heard.items()} == dict.fromkeys(
        range(1, 5), True
    )
    assert check_run(RunDirectory(out)) == []


def test_the_energy_of_a_run_with_many_kills_is_that_of_its_truths(tmp_path: Path) -> None:
    """An aMussel that sleeps is granted seldom, so a stimulus waits for a window that a kill leaves unanswered."""
    data = yaml.safe_load((ROOT / "launch_scripts/scenarios/whole-board-12.yaml").read_text())
    kills = [{"fault": "killed", "id": it, "at_s": at_s} for at_s in range(20, 380, 7) for it in range(1, 13)]
    data |= {"duration_s": 400, "faults": {"at": kills}}
    data["fleet"] |= {"start": {"charge": [0.5, 0.7]}}
    (tmp_path / "killed.yaml").write_text(yaml.safe_dump(data))
    out = RunDirectory(tmp_path / "run")
    command = [*MUSSELBED, "run", str(tmp_path / "killed.yaml"), "--time", "asap", "--out", str(out.path)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=PATIENCE_S)
    assert done.returncode == 0, done.stderr
    waited: set[int] = set()
    left: dict[int, int] = {}
    for line in lines_in(out.journal):
        if line["kind"] == "stimulus":
            left[line["id"]] = line["agent_ms"]
        elif line["kind"] == "died" and line["agent_ms"] <= left.get(line["id"], -1):
            waited.add(line["id"])
    assert waited, "no stimulus waited for a window that a kill left unanswered"
    assert [it.agent_id for it in energy_of(out) if not it.is_exact] == []
