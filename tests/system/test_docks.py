"""Runs over ROS, in processes of their own, decide as in virtual time: an aPad of generation A with six docks."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from programs import lines_of, musselbed
from rosbags.rosbag1 import Reader
from scenario_files import write_scenario

from apad_bridge.records.journal import Line

pytestmark = pytest.mark.system
DECIDED = ("plan", "primitive", "dock", "released", "given_up")
WANTED = (
    "purpose",
    "agent",
    "dock",
    "closed",
    "name",
    "phase",
    "what",
    "steps",
    "reason",
    "solution",
    "full",
)


def flown(folder: Path, docks: int) -> list[tuple[dict[str, Any], list[Line]]]:
    """Summary and journal over ROS and in virtual time, of seven aMussels that are candidates from the start."""
    rows = [(2, 3), (4, 8), (9, 5), (8, 9), (3, 6), (7, 3), (10, 8)]
    table = [f"{n},{north},{east},0.7{n}" for n, (north, east) in enumerate(rows, start=1)]
    (folder / "seven.csv").write_text("\n".join(["id,north,east,battery", *table, ""]))
    path = write_scenario(
        folder / "seven.yaml",
        theta=600,
        duration_s=330,
        fleet={"count": 7, "start": str(folder / "seven.csv")},
        apad={"start_m": [6, 6], "generation": "a", "docks": docks},
        mission={"batch": docks},
    )
    found = []
    for how in (("--speed", 500), ("--time", "asap")):
        out = folder / str(how[-1])
        musselbed("run", path, *how, "--hosting", "one_process", "--out", out)
        found.append((json.loads((out / "summary.json").read_text()), lines_of(out)))
    return found


def decisions(lines: list[Line]) -> list[tuple[int, dict[str, Any]]]:
    return [
        (it["t"], {"kind": it["kind"], **{key: it[key] for key in WANTED if key in it}})
        for it in lines
        if it["kind"] in DECIDED
    ]


def changes(lines: list[Line]) -> list[tuple[int, int, bool]]:
    return [(line["dock"], line["agent"], line["closed"]) for line in lines if line["kind"] == "dock"]


def test_over_ros_it_uses_all_docks_and_decides_as_in_virtual_time_to_the_second(tmp_path: Path) -> None:
    (summary, lines), (virtual, virtual_lines) = flown(tmp_path, 6)
    found = changes(lines)
    assert {dock for dock, _, _ in found} == set(range(6)) and found == changes(virtual_lines)
    assert [closed for _, _, closed in found[:12]] == [True] * 6 + [False] * 6
    assert decisions(lines) == decisions(virtual_lines)
    assert summary["services"] == virtual["services"] >= 6
    assert summary["planned_m"] == pytest.approx(virtual["planned_m"], abs=1e-6)
    # How far within the victory radius, 0.5 m, a leg is driven is a matter of when the arrival is heard.
    assert summary["cost_m"] == pytest.approx(virtual["cost_m"], abs=8 * 0.5)
    # A tick is 0.3 points of uptime for one aMussel.
    assert summary["uptime_paper"] == pytest.approx(virtual["uptime_paper"], abs=2 * 100 / 330)
    assert summary["first_cause"] is None and summary["dropped"] == {}
    assert {len(line["docks"]) for line in lines if line["kind"] == "apad"} == {6}
    with Reader(tmp_path / "500" / "run.bag") as bag:
        assert {f"/musselbed/{it}" for it in ("truth", "beliefs", "apad", "mission")} <= set(bag.topics)
