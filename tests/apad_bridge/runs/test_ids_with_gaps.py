"""Flights of aMussels whose ids have gaps: each is served, also with whole boards in acoustic timeslots."""

from __future__ import annotations

from pathlib import Path

import pytest
from journals import facts_of
from scenario_files import POOL_FILE, SOUND_FILE, WHOLE_FILE

from apad_bridge.assembly.fleet_parts import fleet_config
from apad_bridge.assembly.flight_config import flight_config
from apad_bridge.events.mission_events import DockSwitched
from apad_bridge.runs.in_memory import fly_in_memory
from apad_bridge.scenario.loader import from_data, load, resolve
from apad_bridge.scenario.schema import Scenario

IDS = (3, 7, 12, 24)
CONSECUTIVE = (3, 4, 5, 6)


def of_ids(file: Path, ids: tuple[int, ...], folder: Path) -> Scenario:
    """A scenario with four aMussels of these ids that need charging."""
    places = ("8,6", "20,6", "8,15", "20,15")
    rows = [f"{agent_id},{place},0.7" for agent_id, place in zip(ids, places, strict=True)]
    (folder / "s.csv").write_text("\n".join(["id,north,east,battery", *rows]) + "\n")
    data = resolve(load(file))
    for key in ("count", "first_id", "agent_ids"):
        del data["fleet"][key]
    data["fleet"]["start"] = str(folder / "s.csv")
    data["duration_s"] = 1700.0  # the first round of services, of all four
    return from_data(data, "gaps")


@pytest.mark.parametrize("file", [POOL_FILE, WHOLE_FILE, SOUND_FILE], ids=lambda file: file.stem)
def test_all_are_served(file: Path, tmp_path: Path) -> None:
    figures, recorder = fly_in_memory(of_ids(file, IDS, tmp_path))
    docked = {
        data["agent"] for _, kind, data in facts_of(recorder) if kind == DockSwitched.kind and data["closed"]
    }
    assert docked == set(recorder.taken) == set(IDS)
    assert figures["amussels_lost"] == 0


def test_boards_and_twins_have_the_timeslots_of_ids_without_gaps(tmp_path: Path) -> None:
    """The place among the ids decides, so a frame for four holds four, however far apart their ids are."""
    told = []
    for ids in (IDS, CONSECUTIVE):
        scenario = of_ids(SOUND_FILE, ids, tmp_path)
        config = flight_config(scenario)
        boards, twin = fleet_config(config).maker(), config.twin
        told.append([(boards.config(it).board.slot, twin.schedules[it]) for it in ids])
    assert told[0] == told[1] and [slot for slot, _ in told[0]] == [0, 1, 2, 3]
