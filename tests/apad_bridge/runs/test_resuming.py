import json
import os
from pathlib import Path
from typing import Any

import pytest

from apad_bridge.mission.state import MissionState, Phase
from apad_bridge.planning.solution import Solution, Step, StepKind
from apad_bridge.records.journal import JournalContents
from apad_bridge.runs.failures import PeerFailed
from apad_bridge.runs.options import APadKind, OnDeath, Part, RunOptions, TimeSource
from apad_bridge.runs.resuming import gap_ms, go_on

STATE = MissionState(
    phase=Phase.DOCK,
    since_ms=41_000,
    plan=Solution((Step(StepKind.COLLECT, 7, 1), Step(StepKind.COLLECT, 8, 2))),
    docked=((0, 5),),
    homes=((5, 1.0, 2.0), (7, 3.0, 4.0)),
    primitive_id=12,
    cost_m=33.25,
    services=4,
)
OPTIONS = RunOptions(Part.WHOLE, APadKind.ROS, TimeSource.WALL, 1.0, OnDeath.WAIT, master_uri="http://h:1")


def journal(*lines: dict[str, Any]) -> JournalContents:
    # Through JSON, as a journal's lines are.
    return JournalContents(json.loads(json.dumps(list(lines))), 0)


SNAPSHOT = {"t": 41_000, "kind": "mission", "snapshot": STATE.to_json()}


def test_it_goes_on_from_the_newest_snapshot_and_the_docks_changed_since() -> None:
    found = go_on(
        journal(
            {"t": 1000, "kind": "apad", "battery": 0.9},
            {"t": 1000, "kind": "mission", "snapshot": MissionState().to_json()},
            SNAPSHOT,
            {"t": 44_000, "kind": "dock", "slot": 1, "agent": 7, "closed": True},
            {"t": 44_500, "kind": "dock", "slot": 0, "agent": 5, "closed": False},
            {"t": 44_900, "kind": "apad", "battery": 0.8},
        ),
        epoch=2,
        gap_ms=0,
    )
    assert found.state.docked == ((1, 7),)
    assert (found.state.plan, found.state.homes, found.state.phase) == (STATE.plan, STATE.homes, STATE.phase)
    assert (found.now_ms, found.epoch, found.apad_fraction_at_start) == (44_000, 2, 0.9)


def test_a_run_that_has_ended_is_not_gone_on_with() -> None:
    with pytest.raises(PeerFailed, match="has ended"):
        go_on(journal(SNAPSHOT, {"t": 50_000, "kind": "end"}), 2, 0)


def test_with_a_real_vehicle_the_time_without_a_supervisor_is_granted(tmp_path: Path) -> None:
    path = tmp_path / "journal.jsonl"
    path.write_text("")
    os.utime(path, (1000.0, 1000.0))
    assert gap_ms(OPTIONS, path, 1090.4) == 90_400
    assert go_on(journal(SNAPSHOT), 2, 90_400).now_ms == 131_000
    assert gap_ms(OPTIONS.on_own_master("http://h:2"), path, 1090.4) == 0


def test_options_survive_a_round_trip(tmp_path: Path) -> None:
    OPTIONS.save(tmp_path)
    assert RunOptions.load(tmp_path) == OPTIONS
    assert OPTIONS.next_epoch().epoch == 2


def test_options_of_another_version_are_refused_by_name(tmp_path: Path) -> None:
    (tmp_path / "run.json").write_text('{"part": "whole"}')
    with pytest.raises(ValueError, match=r"run\.json was written by another version"):
        RunOptions.load(tmp_path)
