"""Runs over ROS, in processes of their own, of aPads with another number of docks than four."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from journals import lines_in
from scenario_files import POOL_FILE

from apad_bridge.commands.main import main
from apad_bridge.records.journal import Line
from apad_bridge.scenario import loader

pytestmark = pytest.mark.system
ROOT = Path(__file__).parents[2]
PATIENCE_S = 300.0


def scenario(tmp_path: Path, docks: int, generation: str, fault: str = "none") -> Path:
    """Seven aMussels that are candidates from the start and charged within a minute."""
    rows = [(2, 3), (4, 8), (9, 5), (8, 9), (3, 6), (7, 3), (10, 8)]
    table = [f"{n},{north},{east},0.7{n}" for n, (north, east) in enumerate(rows, start=1)]
    (tmp_path / "seven.csv").write_text("\n".join(["id,north,east,battery", *table, ""]))
    data = loader.resolve(loader.load(POOL_FILE))
    data |= {"theta": 600, "duration_s": 330}
    data["fleet"] |= {"count": 7, "start": str(tmp_path / "seven.csv")}
    data["apad"] |= {"start_m": [6, 6], "generation": generation, "docks": docks, "fault": fault}
    del data["mission"]["batch"]
    path = tmp_path / "scenario.yaml"
    loader.write_resolved(path, loader.from_data(data, "seven"))
    return path


def over_ros(path: Path, out: Path) -> tuple[dict[str, Any], list[Line]]:
    command = [sys.executable, "-m", "apad_bridge.commands.main", "run", str(path), "--speed", "500"]
    command += ["--hosting", "one_process", "--json", "--out", str(out)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE_S, cwd=ROOT)
    assert done.returncode == 0, done.stderr
    return records(out)


def in_virtual_time(path: Path, out: Path) -> tuple[dict[str, Any], list[Line]]:
    words = ["run", str(path), "--time", "asap", "--hosting", "one_process", "--json", "--out", str(out)]
    assert main(words) == 0
    return records(out)


def records(out: Path) -> tuple[dict[str, Any], list[Line]]:
    return json.loads((out / "summary.json").read_text()), lines_in(out / "journal.jsonl")


def changes(lines: list[Line]) -> list[tuple[int, int, bool]]:
    return [(line["dock"], line["agent"], line["closed"]) for line in lines if line["kind"] == "dock"]


@pytest.mark.parametrize(("generation", "docks"), [("a", 6), ("b", 1)])
def test_a_run_over_ros_uses_all_docks_as_one_in_virtual_time_does(
    tmp_path: Path, generation: str, docks: int
) -> None:
    path = scenario(tmp_path, docks, generation)
    summary, lines = over_ros(path, tmp_path / "ros")
    virtual, virtual_lines = in_virtual_time(path, tmp_path / "asap")
    found = changes(lines)
    assert {dock for dock, _, _ in found} == set(range(docks))
    assert [closed for _, _, closed in found[: 2 * docks]] == [True] * docks + [False] * docks
    # Messages of generation B have no stamps: the last change may fall beyond the end.
    assert abs(len(found) - len(changes(virtual_lines))) <= (generation == "b")
    assert all(one == other for one, other in zip(found, changes(virtual_lines), strict=False))
    assert (
        abs(summary["services"] - virtual["services"]) <= (generation == "b") and summary["services"] >= docks
    )
    assert summary["first_cause"] is None and summary["dropped"] == {}
    assert {len(line["docks"]) for line in lines if line["kind"] == "apad"} == {docks}


def test_a_server_that_is_silent_about_higher_docks_loses_no_amussel(tmp_path: Path) -> None:
    """As the published server is. All are brought home, and to the same places as by one that tells all it holds."""
    path = scenario(tmp_path, 4, "a", "counts_docks")
    summary, lines = over_ros(path, tmp_path / "ros")
    virtual, virtual_lines = in_virtual_time(path, tmp_path / "asap")
    assert changes(lines) == changes(virtual_lines) and len(changes(lines)) >= 8
    assert summary["services"] == virtual["services"] >= 4
    reckoned = "silence on position_static of an aMussel that the aPad holds: dead reckoning"
    assert summary["dropped"].keys() == {reckoned}
    places, virtual_places = places_at_the_end(lines), places_at_the_end(virtual_lines)
    assert places.keys() == virtual_places.keys()
    assert all(places[it] == pytest.approx(virtual_places[it], abs=1.0) for it in places)


def places_at_the_end(lines: list[Line]) -> dict[int, tuple[float, float]]:
    return {
        line["id"]: (line["north_um"] / 1e6, line["east_um"] / 1e6)
        for line in lines
        if line["kind"] == "truth"
    }
