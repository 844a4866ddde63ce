"""The faults that need a process of its own for each aMussel, in one flight of real processes: all of them heal."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from programs import ROOT, lines_of, musselbed
from scenario_files import write_scenario

from apad_bridge.analysis.energy.energy import energy_of
from apad_bridge.records.run_directory import RunDirectory

pytestmark = pytest.mark.system

KILLED, STOPPED, LIMITED = 1, 2, 3


def test_processes_that_are_killed_stopped_or_short_of_memory_come_back(tmp_path: Path) -> None:
    faults = [
        {"fault": "killed", "id": KILLED, "at_s": 30},
        {"fault": "stopped", "id": STOPPED, "at_s": 60},
        # A megabyte is far less than the process has: it ends as soon as it needs another page.
        {"fault": "memory_limit", "id": LIMITED, "at_s": 90, "for_s": 60, "value": 1},
        {"fault": "clock_jump", "id": LIMITED, "at_s": 120, "value": 5},
    ]
    fleet = {"count": 4, "start": {"charge": [0.9, 1.0]}}
    path = write_scenario(tmp_path / "faulty.yaml", duration_s=240, fleet=fleet, faults={"at": faults})
    out = tmp_path / "run"
    flown = musselbed("run", path, "--time", "asap", "--out", out, "--json")
    assert json.loads(flown.stdout)["amussels_lost"] == 0
    assert all("refused" not in it for it in lines_of(out, "fault"))
    deaths = {(it["id"], it["cause"]): it for it in lines_of(out, "died")}
    # A process that a busy machine lets stand still for 2 s dies by the watchdog, too.
    assert "SIGKILL" in deaths[KILLED, "BROWN_OUT"]["reason"]
    assert "no answer within 2 s" in deaths[STOPPED, "WATCHDOG"]["reason"]
    assert all(it["gave_up"] is None for it in deaths.values())
    assert "Traceback" not in (out / "fleet" / "nursery.log").read_text()
    over = [it["t"] for it in lines_of(out, "fault_over") if it["fault"] == "memory_limit"]
    assert over == [150_000]
    # Each sends again after its fault, and to the end.
    heard = {it["id"]: it["heard"] for it in lines_of(out, "belief")}
    assert heard.keys() == {1, 2, 3, 4} and min(heard.values()) > 150_000


def test_the_energy_of_a_run_with_many_kills_is_that_of_its_truths(tmp_path: Path) -> None:
    """An aMussel that sleeps is granted seldom, so a stimulus waits for a window that a kill leaves unanswered."""
    kills = [{"fault": "killed", "id": it, "at_s": at_s} for at_s in range(20, 380, 7) for it in range(1, 13)]
    whole = ROOT / "launch_scripts/scenarios/whole-board-12.yaml"
    fleet = {"start": {"charge": [0.5, 0.7]}}
    path = write_scenario(tmp_path / "killed.yaml", whole, duration_s=400, fleet=fleet, faults={"at": kills})
    out = tmp_path / "run"
    musselbed("run", path, "--time", "asap", "--out", out)
    waited: set[int] = set()
    left: dict[int, int] = {}
    for line in lines_of(out, "stimulus", "died"):
        if line["kind"] == "stimulus":
            left[line["id"]] = line["agent_ms"]
        elif line["agent_ms"] <= left.get(line["id"], -1):
            waited.add(line["id"])
    assert waited, "no stimulus waited for a window that a kill left unanswered"
    assert [it.agent_id for it in energy_of(RunDirectory(out)) if not it.is_exact] == []
