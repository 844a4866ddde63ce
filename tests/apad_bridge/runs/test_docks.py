"""Flights with another number of docks than the paper's four: the mission, scripts, the journal and the replay page."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from journals import facts_of, lines_in
from scenario_files import POOL_FILE, silent_in_its_dock

from apad_bridge.analysis.replay.series import whole_view
from apad_bridge.commands.main import main
from apad_bridge.mission.script_values import Refused
from apad_bridge.records.journal import read_journal
from apad_bridge.runs.exits import Exit
from apad_bridge.runs.in_memory import fly_in_memory
from apad_bridge.runs.script_in_memory import fly_script
from apad_bridge.scenario.loader import from_data, load, resolve, write_resolved
from apad_bridge.scenario.schema import Scenario
from apad_bridge.scripting.api import Api


def eight(docks: int) -> Scenario:
    """Eight aMussels that are all candidates from the start."""
    data = resolve(load(POOL_FILE))
    data |= {"theta": 600, "duration_s": 500}
    data["fleet"] |= {"count": 8, "start": {"charge": [0.6, 0.7]}}
    data["apad"]["docks"] = docks
    del data["mission"]["batch"]
    return from_data(data, "eight")


def changes(events: list[tuple[int, str, dict[str, Any]]]) -> list[tuple[int, int, bool]]:
    """(dock index, agent, closed) of each change at the docks."""
    return [(data["dock"], data["agent"], data["closed"]) for _, kind, data in events if kind == "dock"]


@pytest.mark.parametrize("docks", [1, 2, 6])
def test_the_mission_fills_all_docks_before_it_releases(docks: int) -> None:
    scenario = eight(docks)
    assert scenario.mission.batch == docks
    figures, recorder = fly_in_memory(scenario)
    found = changes(facts_of(recorder))
    assert [dock for dock, _, _ in found[:docks]] == list(range(docks))
    assert all(closed for _, _, closed in found[:docks])
    assert sorted(found[docks : 2 * docks]) == sorted(
        (dock, agent, False) for dock, agent, _ in found[:docks]
    )
    left_full = [data["agent"] for _, kind, data in facts_of(recorder) if kind == "released" and data["full"]]
    assert figures["services"] == len(left_full) >= docks


@pytest.mark.parametrize(("docks", "why"), [(6, "the docks are 1 to 6"), (1, "the only dock is 1")])
def test_a_script_uses_the_docks_that_there_are(docks: int, why: str) -> None:
    def script(api: Api) -> None:
        found.append(api.free_docks())
        found.append((api.collect(3, docks), api.docks()[docks], api.agent(3).dock))
        with pytest.raises(Refused, match=f"there is no dock {docks + 1}: {why}"):
            api.collect(4, docks + 1)
        with pytest.raises(Refused, match=f"there is no dock {docks + 1}: {why}"):
            api.docking(True, docks + 1, 3)
        found.append(len(api.plan_collection(batch=8).steps))

    found: list[Any] = []
    flight = fly_script(eight(docks), script)
    assert flight.error is None, flight.ended_by
    assert found == [[*range(1, docks + 1)], (True, 3, docks), docks - 1]


@pytest.mark.parametrize("docks", [1, 6])
def test_a_runs_records_tell_how_many_docks_there_were(
    docks: int, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    scenario = tmp_path / "eight.yaml"
    write_resolved(scenario, eight(docks))
    run = tmp_path / "run"
    words = ["run", str(scenario), "--time", "asap", "--hosting", "one_process", "--out", str(run), "--json"]
    assert main(words) == Exit.DONE
    journal = lines_in(run / "journal.jsonl")
    left_full = [line["agent"] for line in journal if line["kind"] == "released" and line["full"]]
    assert json.loads(capsys.readouterr().out)["services"] == len(left_full) >= docks
    assert {len(line["docks"]) for line in journal if line["kind"] == "apad"} == {docks}
    assert {line["snapshot"]["dock_count"] for line in journal if line["kind"] == "mission"} == {docks}
    data = whole_view(load(run / "scenario.yaml"), read_journal(run / "journal.jsonl")).data(None)
    assert len(data["dock_bearings"]) == docks and {len(it) for it in data["docks"]} == {docks}


def test_a_run_from_before_there_was_a_number_is_shown_with_four(tmp_path: Path) -> None:
    data = resolve(load(POOL_FILE))
    del data["apad"]["docks"]
    old = from_data(data, "old")
    assert old.apad.docks == 4
    agents = [{"id": 1, "north_m": 1.0, "east_m": 2.0, "primary": 1.0, "secondary": 1.0}]
    journal = tmp_path / "journal.jsonl"
    lines = [
        {"t": 0, "kind": "run", "format": 2, "scenario": "old", "theta": 30, "seed": 1, "duration_s": 60.0}
        | {"pool_threshold": 0.8, "full_threshold": 0.99, "agents": agents},
        {"t": 1000, "kind": "apad", "north_m": 1.0, "east_m": 2.0, "heading_rad": 0.0, "voltage_v": None}
        | {"battery": None, "primitive": "none", "docks": [-1, -1, -1, 1]},
    ]
    journal.write_text("".join(json.dumps(line) + "\n" for line in lines))
    shown = whole_view(old, read_journal(journal)).data(None)
    assert shown["docks"] == [[None] * 4, [None, None, None, 1]] and len(shown["dock_bearings"]) == 4


def test_one_that_is_never_heard_in_its_dock_counts_where_the_docks_name_it() -> None:
    """In virtual time the docks answer as those of generation A do."""
    figures, recorder = fly_in_memory(silent_in_its_dock())
    kinds = [kind for _, kind, _ in facts_of(recorder)]
    assert [data for _, kind, data in facts_of(recorder) if kind == "released"] == [
        {"agent": 1, "full": True}
    ]
    assert figures["services"] == 1 and "docks_disagree" not in kinds
