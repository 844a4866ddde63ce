import json
import os
import shutil
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from journals import state_of
from scenario_files import POOL_FILE

from apad_bridge.assembly import flight_parts
from apad_bridge.assembly.flight_config import flight_config
from apad_bridge.events.event import Event
from apad_bridge.events.fleet_events import Presence, PresenceChanged
from apad_bridge.events.mission_events import DockSwitched, MissionChanged, MissionEnd, MissionState, Phase
from apad_bridge.events.run_events import EndReason, KnowledgeRestored, RunEnded
from apad_bridge.events.vehicle_events import APadMoved
from apad_bridge.planning.solution import Step, StepKind
from apad_bridge.records.journal import read_journal
from apad_bridge.records.recorder import Recorder
from apad_bridge.records.run_directory import RunDirectory
from apad_bridge.records.summary import Ending
from apad_bridge.runs.exits import Exit
from apad_bridge.runs.parent_protocol import Failed, from_line
from apad_bridge.runs.start_state import (
    StartState,
    find_resume_point,
    gap_ms,
    resume_run,
    with_apad_as_seen,
)
from apad_bridge.scenario.loader import SHIPPED, load
from apad_bridge.scenario.run_options import APadKind, BenchPart, OnDeath, RunOptions, TimeSource
from apad_bridge.scenario.starts import starts_of
from apad_bridge.supervisor.supervisor import LearnedState
from apad_bridge.vehicle.link_errors import PeerFailed
from firmware_model.packets import StatusPacket
from firmware_model.states import State

STATE = MissionState(
    phase=Phase.DOCK,
    since_ms=41_000,
    plan=(Step(StepKind.COLLECT, 7, 1), Step(StepKind.COLLECT, 8, 2)),
    docked=((0, 5),),
    homes=((5, 1.0, 2.0), (7, 3.0, 4.0)),
    primitive_id=12,
    cost_m=33.25,
    services=4,
)
OPTIONS = RunOptions(
    BenchPart.WHOLE, APadKind.ROS, TimeSource.WALL, 1.0, OnDeath.WAIT, master_uri="http://h:1"
)


def line(at_ms: int, event: Event) -> dict[str, Any]:
    return {"t": at_ms, "kind": event.kind, **event.data}


def snapshot(at_ms: int, state: MissionState) -> dict[str, Any]:
    return line(at_ms, MissionChanged(state.phase, state))


def apad_with(battery: float) -> APadMoved:
    return APadMoved(1.0, 2.0, 0.0, 16.0, battery, "none", [-1, -1, -1, -1])


SNAPSHOT = snapshot(41_000, STATE)


def test_it_goes_on_from_the_newest_snapshot_and_the_docks_changed_since() -> None:
    found = find_resume_point(
        state_of(
            [
                line(1000, apad_with(0.9)),
                snapshot(1000, MissionState()),
                SNAPSHOT,
                line(44_000, DockSwitched(1, 7, closed=True)),
                line(44_500, DockSwitched(0, 5, closed=False)),
                line(44_900, apad_with(0.8)),
            ]
        ),
        epoch=2,
        gap_ms=0,
    )
    assert found.state.docked == ((1, 7),)
    assert (found.state.plan, found.state.homes, found.state.phase) == (STATE.plan, STATE.homes, STATE.phase)
    assert (found.now_ms, found.epoch, found.apad_fraction_at_start) == (44_000, 2, 0.9)


def test_a_run_that_has_ended_is_not_gone_on_with() -> None:
    with pytest.raises(PeerFailed, match="has ended"):
        find_resume_point(state_of([SNAPSHOT, line(50_000, RunEnded("mission time"))]), 2, 0)


def test_with_a_real_vehicle_the_time_without_a_supervisor_is_granted(tmp_path: Path) -> None:
    path = tmp_path / "journal.jsonl"
    path.write_text("")
    os.utime(path, (1000.0, 1000.0))
    assert gap_ms(OPTIONS, path, 1090.4) == 90_400
    assert find_resume_point(state_of([SNAPSHOT]), 2, 90_400).now_ms == 131_000
    assert gap_ms(OPTIONS.on_own_master("http://h:2"), path, 1090.4) == 0


@pytest.mark.parametrize("text", ["", "[1]", '{"part": ', "\x00\x01", "null", '{"part": "whole"}'])
def test_broken_options_are_named_by_their_file(tmp_path: Path, text: str) -> None:
    (tmp_path / "run.json").write_text(text)
    with pytest.raises(ValueError, match=rf"^{tmp_path}/run\.json (is damaged|was written by another)"):
        RunOptions.load(tmp_path)
    OPTIONS.save(tmp_path)
    assert RunOptions.load(tmp_path) == OPTIONS and OPTIONS.next_epoch().epoch == 2


POOL = load(POOL_FILE)
CONFIG = flight_config(POOL)
FREE = (None, None, None, None)
LOST = "Messages in transit were lost."


def a_crash(path: Path) -> tuple[RunDirectory, LearnedState]:
    """The records of a supervisor that received from aMussel 5, handed over 2, retired 3, and was killed at second 3."""
    recorder, learned = third_second(RunDirectory(path / "broken"))
    shutil.copytree(path / "broken", path / "run")
    recorder.close()
    return RunDirectory(path / "run"), learned


def begun(directory: RunDirectory) -> tuple[Recorder, LearnedState]:
    directory.path.mkdir()
    recorder = Recorder(directory, POOL, POOL.fleet.ids)
    learned = flight_parts.initial_learned_state(CONFIG)
    recorder.begin_checkpoint(learned, 0)
    return recorder, learned


def third_second(directory: RunDirectory) -> tuple[Recorder, LearnedState]:
    recorder, learned = begun(directory)
    learned.beliefs.hear(StatusPacket(5, 0, State.ACTIVE, 0.5, 1.0, 2.0, 3.0, 3.0, 1000), 1000)
    recorder.event(1000, PresenceChanged(2, Presence.REAL, "/lab"))
    recorder.event(2000, PresenceChanged(3, Presence.RETIRED, "a service call"))
    for now_ms in (1000, 2000, 3000):
        recorder.tick(now_ms, learned.beliefs.all(), None, None, "none", FREE)
    return recorder, learned


def resumed(directory: RunDirectory, options: RunOptions = OPTIONS) -> tuple[StartState, list[str]]:
    """What another supervisor starts from, and what it tells."""
    lines: list[str] = []
    start_state = resume_run(directory, CONFIG, options.next_epoch(), lines.append)
    start_state.recorder.close()
    return start_state, lines


def test_what_is_restored_and_what_is_lost_is_told_and_journaled(tmp_path: Path) -> None:
    directory, learned = a_crash(tmp_path)
    start_state, lines = resumed(directory, OPTIONS.on_own_master("http://h:2"))
    assert lines == [
        LOST,
        "run.bag was repaired; 3 s of samples are lost",
        "still real: aMussel 2",
        "still retired: aMussel 3",
        "believed as before: 1 aMussels, as of 1 s of mission time; the longest silence is 2 s now",
    ]
    assert start_state.presences.simulated == set(POOL.fleet.ids) - {2, 3}
    assert start_state.learned.beliefs.all() == learned.beliefs.all() != []
    assert start_state.start_ms == 3000
    ((_, restored),) = read_journal(directory.journal).events(KnowledgeRestored)
    assert restored.told == lines


BATTERY = '"primary":[0,9,0,0,1],"secondary":[0,9,0,0,1]'
WHERE = '"north_um":0,"east_um":0,"depth":[0,0],"buoyancy":"SINK","docked":false'


@pytest.mark.parametrize(
    ("lines", "why"),
    [
        (
            ['{"t":9,"kind":"leg","metres":1}', '{"t":9,"kind":"dock","dock":0,"agent":1}'],
            ", line {}: a line `dock`",
        ),
        (
            [
                f'{{"t":9,"kind":"truth","id":1,"agent_ms":{ms},"state":"ACTIVE",{BATTERY},{WHERE}}}'
                for ms in (9, 8)
            ],
            ": two of its lines contradict each other: time went back",
        ),
    ],
)
def test_a_damaged_journal_is_one_line_for_the_parent(tmp_path: Path, lines: list[str], why: str) -> None:
    directory, _ = a_crash(tmp_path)
    directory.write_inputs(POOL, starts_of(POOL))
    OPTIONS.on_own_master("http://h:2").save(directory.path)
    before = directory.journal.read_bytes()
    directory.journal.write_bytes(before + "".join(f"{line}\n" for line in lines).encode())
    ended = subprocess.run(
        [sys.executable, "-m", "apad_bridge.runs.supervisor_process", str(directory.path), "--resume"],
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert (ended.returncode, ended.stderr) == (Exit.PEER_FAILED, "")
    message = from_line(ended.stdout.rstrip("\n"))
    number = before.count(b"\n") + len(lines)
    assert isinstance(message, Failed) and message.reason.startswith(
        f"{directory.journal}{why.format(number)}"
    )
    assert "\n" not in message.reason


def without_counts(checkpoint: bytes) -> bytes:
    lines = [json.loads(line) for line in checkpoint.splitlines()]
    return b"".join(
        json.dumps({k: v for k, v in it.items() if k != "counts"}).encode() + b"\n" for it in lines
    )


NOTHING = "no beliefs until the aMussels report again: checkpoint.jsonl"


@pytest.mark.parametrize(
    ("left", "told", "believed"),
    [
        pytest.param(None, f"{NOTHING}: No such file", [], id="none"),
        pytest.param(
            lambda _: b'{"format":0}\n', f"{NOTHING} is of another version", [], id="another version"
        ),
        pytest.param(
            without_counts,
            "Messages in transit and the counts of dropped input were lost.",
            [5],
            id="no counts",
        ),
        pytest.param(
            lambda whole: whole + b'{"t":4000,"lea',
            ". What was learned after 1 s is lost: checkpoint.jsonl is torn there",
            [5],
            id="torn",
        ),
    ],
)
def test_of_a_damaged_checkpoint_it_takes_what_is_whole_and_says_what_is_lost(
    tmp_path: Path, left: Callable[[bytes], bytes] | None, told: str, believed: list[int]
) -> None:
    directory, _ = a_crash(tmp_path)
    before = directory.checkpoint.read_bytes()
    directory.checkpoint.unlink()
    if left is not None:
        directory.checkpoint.write_bytes(left(before))
    start_state, lines = resumed(directory)
    assert [it.agent_id for it in start_state.learned.beliefs.all()] == believed
    assert told in (lines[0] if "counts" in told else lines[-1])


def test_one_of_several_aPads_goes_on_at_the_time_of_the_others(tmp_path: Path) -> None:
    """They follow one clock, which may be faster than the wall's: its supervisor died, and the others flew on to 90 s."""
    directory, _ = a_crash(tmp_path)
    (tmp_path / "apad2").mkdir()
    (tmp_path / "apad2" / "journal.jsonl").write_text('{"t":90000,"kind":"tick"}\n')
    several = replace(OPTIONS, apads=(CONFIG.scenario.apad.name, "apad2"))
    assert resumed(directory, several)[0].start_ms >= 90_000


def ticked(recorder: Recorder, now_ms: int, dropped: dict[str, int]) -> None:
    recorder.tick(now_ms, [], None, None, "none", FREE, lambda: Counter(dropped))


def killed(directory: RunDirectory, path: Path) -> RunDirectory:
    """A copy of a run's directory as it is now."""
    shutil.copytree(directory.path, path)
    return RunDirectory(path)


def test_counts_of_what_was_dropped_go_on_through_two_kills(tmp_path: Path) -> None:
    directory = RunDirectory(tmp_path / "first")
    first, _ = begun(directory)
    dropped = {"echo": 1}
    ticked(first, 1000, dropped)
    dropped |= {"echo": 2, "late": 1}
    ticked(first, 2000, dropped)
    dropped["echo"] = 9  # in the tick in which it is killed
    left = killed(directory, tmp_path / "second")
    first.close()

    lines: list[str] = []
    options = OPTIONS.on_own_master("http://h:2").next_epoch()
    second = resume_run(left, CONFIG, options, lines.append)
    assert lines[0] == LOST
    second.recorder.begin_checkpoint(second.learned, second.start_ms)
    at_once = killed(left, tmp_path / "at_once")
    ticked(second.recorder, 3000, {"echo": 4})
    later = killed(left, tmp_path / "later")
    second.recorder.close()

    for left, more in ((at_once, 0), (later, 4)):
        third = resume_run(left, CONFIG, options, lines.append)
        third.recorder.begin_checkpoint(third.learned, third.start_ms)
        summary = third.recorder.finish(
            4000, Ending(MissionEnd(EndReason.MISSION_TIME), 0.0, 0.0, 0, None, {"echo": 10})
        )
        assert summary["dropped"] == {"echo": 2 + more + 10, "late": 1}


def test_who_ends_a_run_takes_the_checkpoint_away_and_who_is_stopped_leaves_it(tmp_path: Path) -> None:
    for name, ends in (("ended", True), ("stopped", False)):
        directory = RunDirectory(tmp_path / name)
        recorder, _ = third_second(directory)
        if ends:
            recorder.finish(3000, Ending(MissionEnd(EndReason.MISSION_TIME), 0.0, 0.0, 0, None, {}))
        recorder.close()
        assert directory.checkpoint.exists() is not ends


def test_on_a_real_apad_what_is_believed_is_as_old_as_it_is(tmp_path: Path) -> None:
    directory, _ = a_crash(tmp_path)
    two_minutes_ago_s = time.time() - 120
    os.utime(directory.journal, (two_minutes_ago_s, two_minutes_ago_s))
    start_state, lines = resumed(directory)
    assert 122_000 <= start_state.start_ms <= 135_000
    assert lines[-1].endswith(f"the longest silence is {(start_state.start_ms - 1000) // 1000} s now")
    start_state.learned.beliefs.advance(start_state.start_ms)
    assert [it.heard_ms for it in start_state.learned.beliefs.all()] == [1000]


def test_a_failed_resume_does_not_hide_the_time_without_a_supervisor(tmp_path: Path) -> None:
    """Its supervisor died ten minutes ago. A first resume finds no aPad and ends without a tick; a second one follows."""
    directory, _ = a_crash(tmp_path)
    ten_minutes_ago_s = time.time() - 600
    os.utime(directory.journal, (ten_minutes_ago_s, ten_minutes_ago_s))
    first, _ = resumed(directory)
    second, _ = resumed(directory)
    assert second.start_ms >= first.start_ms >= 600_000
    ticked(third := resume_run(directory, CONFIG, OPTIONS, print).recorder, 700_000, {})
    third.close()
    assert resumed(directory)[0].start_ms <= 760_000  # what the ticks have come to is not granted twice


@pytest.mark.parametrize("place_m", [(40.0, 33.0), (60.0, 10.0)], ids=["near the edge", "outside"])
def test_an_apad_that_was_seen_beyond_its_fences_clearance_is_resumed_there(
    place_m: tuple[float, float],
) -> None:
    """A current took it there after an OFF; then the machine was restarted."""
    fenced = load(SHIPPED / "real-apad.yaml")
    seen = with_apad_as_seen(fenced, APadMoved(*place_m, 0.0, 16.0, 0.5, "none", [-1, -1, -1, -1]))
    assert seen is not None and seen.apad.start_m == place_m
