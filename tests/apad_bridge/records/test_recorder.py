"""Tests the recorder on a real flight in virtual time, and on ticks made by hand."""

import json
import os
import shutil
from collections import Counter
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from statistics import mean
from unittest.mock import Mock

import pytest
from journals import lines_in
from rosbags.rosbag1 import Reader
from scenario_files import POOL_FILE

from agents.mussel.body import Body
from agents.mussel.outputs import Truth
from agents.mussel.physical import Physical
from agents.time_scale import TimeScale
from apad_bridge.assembly import fleet_parts
from apad_bridge.assembly.flight_config import flight_config
from apad_bridge.beliefs.belief import Belief, CapacityLeft
from apad_bridge.events.fleet_events import Presence, PresenceChanged, ProcessDied
from apad_bridge.events.mission_events import LegBegan, MissionEnd
from apad_bridge.events.person_events import ScriptReported
from apad_bridge.events.run_events import EndReason, RunResumed
from apad_bridge.mission.facts import PlacedSample, SampleSource
from apad_bridge.records.bag import BagWriter
from apad_bridge.records.journal import read_journal
from apad_bridge.records.recorder import DAY_MS, Recorder, RecordsFailed
from apad_bridge.records.run_directory import RunDirectory
from apad_bridge.records.sample_file import SampleFile, read_samples
from apad_bridge.records.samples import TruthExtrapolator
from apad_bridge.records.summary import SUMMARY, Ending
from apad_bridge.records.uptime_figures import AMUSSEL
from apad_bridge.runs.in_memory import open_flight
from apad_bridge.scenario.loader import load
from apad_bridge.scenario.starts import read_starts
from apad_bridge.vehicle.commands import BatteryReported, PoseReported
from firmware_model.actions import Buoyancy
from firmware_model.packets import Reported
from firmware_model.packets.sample_record import SampleRecord
from firmware_model.power.charge import FULL, Battery, Flow
from firmware_model.states import State

BATTERY_MIN = 600.0
ENDING = Ending(MissionEnd(EndReason.MISSION_TIME), 12.5, 13.0, 3, 0.25, {"a packet": 2})
FREE = (None, None, None, None)


@pytest.fixture(scope="module")
def scenario():
    return replace(load(POOL_FILE), duration_s=600.0)


def new_directory(path):
    return RunDirectory.create("pool-12", datetime(2026, 5, 4, tzinfo=UTC), path)


def fly(scenario, recorder, until_ms=None):
    """Flies the whole flight, or its ticks up to `until_ms`."""
    flight, _ = open_flight(scenario, recorder_of=lambda _: recorder)
    if until_ms is None:
        flight.run()
    else:
        for now_ms in range(0, until_ms + 1, 1000):
            flight.tick(now_ms)


class Tee:
    """Passes the same calls to two recorders; the second dies and is resumed at `resume_ms`."""

    def __init__(self, whole, broken, resume, resume_ms):
        self.whole, self.broken, self._resume, self._resume_ms = whole, broken, resume, resume_ms

    def __getattr__(self, name):
        def both(*given):
            for recorder in (self.whole, self.broken):
                getattr(recorder, name)(*given)
            if (name, given[0]) == ("tick", self._resume_ms):
                self.broken = self._resume()

        return both


def test_a_flight_leaves_everything_behind(tmp_path, scenario):
    directory = new_directory(tmp_path / "run")
    recorder = Recorder(directory, scenario, scenario.fleet.ids)
    fly(scenario, recorder)
    summary = recorder.finish(600_000, ENDING)
    each, ends = summary["amussels"], read_starts(tmp_path / "run", scenario.area, range(1, 13))
    assert json.loads(directory.summary.read_text()) == summary
    assert list(summary) == [field.name for field in SUMMARY if field.name != "uptime_missing"]
    assert list(each) == [str(agent_id) for agent_id in range(1, 13)]
    assert {tuple(it) for it in each.values()} == {tuple(field.name for field in AMUSSEL)}
    of_all = {key: [it[key] for it in each.values()] for key in ("uptime_paper", "uptime_submerged")}
    told = {"agents": 12, "mission_s": 600.0, "theta": 30, "cost_m": 12.5, "planned_m": 13.0, "services": 3}
    told |= {"ended_by": "mission time", "samples_taken": None}
    told |= {
        key: {"mean": pytest.approx(mean(it)), "max": max(it), "min": min(it)} for key, it in of_all.items()
    }
    told["final_charge_mean"] = pytest.approx(mean(it["final_charge"] for it in each.values()))
    told["active_mean"] = pytest.approx(12 * mean(of_all["uptime_paper"]) / 100)
    assert {key: summary[key] for key in told} == told and summary["dropped"]["a packet"] == 2
    assert {it["samples_taken"] for it in each.values()} == {None}
    assert 0 < summary["uptime_submerged"]["mean"] < summary["uptime_paper"]["mean"] < 100
    assert summary["final_charge_mean"] == pytest.approx(sum(end.primary for end in ends) / 12)
    left_full = Counter(str(it["agent"]) for it in lines_of(recorder, "released") if it["full"])
    assert left_full and left_full == Counter({it: figures["services"] for it, figures in each.items()})
    with Reader(directory.path / "run.bag") as reader:
        counts = {topic.rpartition("/")[2]: info.msgcount for topic, info in reader.topics.items()}
        assert counts["truth"] == 601 and min(counts["beliefs"], counts["apad"]) >= 600
        assert (reader.start_time, reader.end_time) == (1, 600_000_000_001)
    kinds = {line["kind"] for line in lines_in(directory.journal)}
    assert {"truth", "apad", "belief", "mission", "plan", "primitive", "stimulus"} <= kinds


def test_a_resumed_run_counts_as_if_nothing_had_happened(tmp_path, scenario):
    ids = scenario.fleet.ids
    resumed = []

    def die_and_resume():
        # A kill leaves the files as they are now; the dead recorder's own files are closed elsewhere.
        shutil.copytree(tmp_path / "broken", tmp_path / "resumed")
        with (tmp_path / "resumed" / "journal.jsonl").open("ab") as journal:
            journal.write(b'{"t":30')
        recorder, report = Recorder.resume(
            RunDirectory.open(tmp_path / "resumed"), scenario, ids, battery_min=BATTERY_MIN
        )
        resumed.append(report)
        return recorder

    broken = Recorder(new_directory(tmp_path / "broken"), scenario, ids)
    whole = Recorder(new_directory(tmp_path / "whole"), scenario, ids, battery_min=BATTERY_MIN)
    tee = Tee(whole, broken, die_and_resume, 337_000)
    fly(scenario, tee)
    summary, again = tee.whole.finish(600_000, ENDING), tee.broken.finish(600_000, ENDING)
    broken.close()
    assert again == summary and summary["uptime_equal_charge"] is not None
    assert (tmp_path / "resumed" / "ends.csv").read_text() == (tmp_path / "whole" / "ends.csv").read_text()
    (report,) = resumed
    assert (report.journal.dropped, report.journal_torn_bytes, report.bag) == (1, 7, "run.bag")
    # The chunk that was being filled since 330 s is lost; the journal knows the tick of the kill.
    assert (report.journal.last_ms, report.bag_lost_ms) == (337_000, 7_000)
    journal = read_journal(tmp_path / "resumed" / "journal.jsonl")
    ((_, told),) = journal.events(RunResumed)
    assert (journal.dropped, told.bag_lost_ms, told.journal_torn_bytes) == (0, report.bag_lost_ms, 7)
    for name, end_ms in (("run.bag", 330_000), ("run-1.bag", 600_000)):
        with Reader(tmp_path / "resumed" / name) as reader:
            assert reader.end_time // 1_000_000 == end_ms


def test_a_supervisor_that_dies_before_its_first_samples_lost_none_of_the_former_ones(tmp_path, scenario):
    ids = scenario.fleet.ids
    first = Recorder(new_directory(tmp_path / "run"), scenario, ids)
    first.event(30_000, LegBegan(1.0))
    first.tick(31_000, [], None, None, "none", ())
    first.close()
    second, _ = Recorder.resume(RunDirectory.open(tmp_path / "run"), scenario, ids)
    shutil.copytree(tmp_path / "run", tmp_path / "killed")  # its bag is open, and empty on the disk
    second.close()
    third, report = Recorder.resume(RunDirectory.open(tmp_path / "killed"), scenario, ids)
    third.close()
    assert (report.bag, report.bag_lost_ms) == ("run-1.bag", 0)


def test_a_supervisor_that_dies_as_it_begins_its_bag_lost_no_samples(tmp_path, scenario, monkeypatch):
    ids = scenario.fleet.ids
    first = Recorder(new_directory(tmp_path / "run"), scenario, ids)
    first.event(30_000, LegBegan(1.0))
    first.tick(31_000, [], None, None, "none", ())
    first.close()

    def begun_and_killed(*given):
        bag = BagWriter(*given)
        shutil.copytree(tmp_path / "run", tmp_path / "killed")
        return bag

    with monkeypatch.context() as patch:
        patch.setattr("apad_bridge.records.recorder.BagWriter", begun_and_killed)
        second, _ = Recorder.resume(RunDirectory.open(tmp_path / "run"), scenario, ids)
    second.close()
    third, report = Recorder.resume(RunDirectory.open(tmp_path / "killed"), scenario, ids)
    third.close()
    assert (report.bag, report.bag_lost_ms) == ("run-1.bag", 0)


def hand_made(at_ms, agent_id=3, *, east_um=0, docked=False, charge=FULL, state=State.ACTIVE):
    batteries = Battery(0, charge, Flow.RESTING), Battery(0, FULL, Flow.RESTING)
    return Truth(at_ms, agent_id, state, Physical(*batteries, 0, east_um, 0, 0, Buoyancy.SINK, docked))


@pytest.fixture
def recorder(tmp_path, scenario):
    recorder = Recorder(new_directory(tmp_path / "run"), scenario, [3, 4])
    yield recorder
    recorder.close()


def lines_of(recorder, kind):
    recorder._journal.flush()
    entries = read_journal(recorder._directory.journal).entries
    return [it.line for it in entries if it.event.kind == kind]


def seen(*truths):
    return lambda recorder: recorder.truths(list(truths))


def at(now_ms, beliefs=(), pose=None, battery=None, primitive="none", docks=FREE):
    return lambda recorder: recorder.tick(now_ms, list(beliefs), pose, battery, primitive, docks)


def happened(at_ms, event):
    return lambda recorder: recorder.event(at_ms, event)


def believed(charge=0.5, state=State.ACTIVE, **more):
    return Belief(3, 0, state, charge, 1.0, 4.0, 6.0, **more)


def each_second(*beliefs):
    return [at(1000 * second, [it]) for second, it in enumerate(beliefs)]


def apad(now_ms, north_m=0.0, heading_rad=3.14, left=0.9, primitive="hold position", docks=FREE):
    battery = BatteryReported(now_ms, 15.0, left)
    return at(now_ms, (), PoseReported(now_ms, north_m, 0.0, heading_rad), battery, primitive, docks)


AT_LAST = (0.06, -3.0, 0.8949, "dock", (3, None, None, None))
DOCKED = {"docked": True, "state": State.CHARGING}
LEARNED = [(0.6, 1.0), (0.6, 0.995), (0.605, 0.991), (0.6, 0.99), (0.61, 0.99), (0.61, 0.99)]
JOURNALED = {
    # In a dock it moves with the aPad; the truth at its release has the place. Mission time is rounded up.
    "a truth that changed or moved": (
        [
            *(seen(hand_made(it, east_um=um)) for it, um in ((0, 0), (30_000, 250_000), (60_000, 250_001))),
            seen(hand_made(90_000, east_um=400_000)),
            seen(hand_made(120_001, **DOCKED)),
            seen(hand_made(150_000, east_um=9_000_000, **DOCKED)),
            seen(hand_made(180_000, east_um=9_000_000)),
        ],
        ("truth", "t", "agent_ms", "east_um"),
        [(0, 0, 0), (2000, 60_000, 250_001), (4001, 120_001, 0), (6000, 180_000, 9_000_000)],
    ),
    # Of an aMussel that died in its sleep: its death is at the end of the last window that it answered.
    "a truth that becomes known late with the time at which it did": (
        [
            seen(hand_made(60_000)),
            at(5000),
            seen(hand_made(90_000, charge=0), hand_made(150_001, 4), hand_made(150_000, charge=5)),
        ],
        ("truth", "t", "id", "agent_ms"),
        [(2000, 3, 60_000), (5000, 3, 90_000), (5000, 3, 150_000), (5001, 4, 150_001)],
    ),
    # The third is 2 degrees, across the south.
    "the aPad when it matters": (
        [
            apad(0),
            apad(1000, 0.05),
            apad(2000, 0.06),
            apad(3000, 0.06, -3.11),
            apad(4000, 0.06, -3.0),
            apad(5000, 0.06, -3.0, 0.8951),
            apad(6000, 0.06, -3.0, 0.8949),
            apad(7000, *AT_LAST[:4]),
            *(apad(it, *AT_LAST) for it in (8000, 9000, 67_000, 68_000, 69_000)),
        ],
        ("apad", "t", "docks"),
        [
            *((second * 1000, [-1] * 4) for second in (0, 2, 4, 6, 7)),
            *((second * 1000, [3, -1, -1, -1]) for second in (8, 68)),
        ],
    ),
    "a belief whose charge moved or whose state changed": (
        each_second(*map(believed, (0.8, 0.7901, 0.7899)), believed(0.7898, State.SURFACING)),
        ("belief", "t"),
        [(0,), (2000,), (3000,)],
    ),
    "a quantity that nobody estimates, once it changed by its step": (
        each_second(*(believed(reported=Reported(it)) for it in (None, 9.0, 8.01, 8.0, 7.5))),
        ("belief", "t", "reported"),
        [(0, None), (1000, {"depth_m": 9.0}), (3000, {"depth_m": 8.0})],
    ),
    # A line each tick would outgrow all others of a long run.
    "what a twin learns of a capacity, once an end moved by a hundredth": (
        each_second(believed(), *(believed(capacity_left=CapacityLeft(*it)) for it in LEARNED)),
        ("capacity", "t", "id", "low", "high"),
        [(1000, 3, 0.6, 1.0), (4000, 3, 0.6, 0.99), (5000, 3, 0.61, 0.99)],
    ),
    # Only the last of quiet ticks in a row is read.
    "the time of a quiet tick": (
        [at(1000), at(2000), happened(3000, LegBegan(1.0)), at(3000)],
        ("tick", "t"),
        [(2000,)],
    ),
}
"""What comes, and of which kind the journal has lines, with which values."""


@pytest.mark.parametrize(("calls", "shown", "lines"), JOURNALED.values(), ids=JOURNALED)
def test_the_journal_has(recorder, calls, shown, lines):
    for call in calls:
        call(recorder)
    kind, *keys = shown
    assert [tuple(map(line.get, keys)) for line in lines_of(recorder, kind)] == lines


SUMMARIES = {
    "a truth that cannot be is dropped and counted": (
        [seen(hand_made(60_000), hand_made(30_000, charge=0), hand_made(0, agent_id=99))],
        {
            "emptied": 0,
            "dropped": {
                "a packet": 2,
                "a truth of an unknown aMussel": 1,
                "a truth that a newer one overtook": 1,
            },
        },
    ),
    "an aMussel given up is active no more": (
        [
            seen(hand_made(0, 3), hand_made(0, 4)),
            happened(5000, ProcessDied(3, 120_000, "BROWN_OUT", "killed", "too often")),
        ],
        {"uptime_paper": {"mean": 65.0, "max": 100.0, "min": 30.0}, "gave_up": 1},
    ),
    "without truth it says why": (
        [at(1000, [Belief(3, 1000, State.ACTIVE, 0.5, 0.75, 4.0, 6.0)], PoseReported(1000, 0.0, 0.0, 0.0))],
        {"uptime_paper": None, "amussels_lost": None, "ends": [(3, 4.0, 0.5, 0.75)]},
    ),
}


@pytest.mark.parametrize(("calls", "wanted"), SUMMARIES.values(), ids=SUMMARIES)
def test_the_summary(recorder, scenario, tmp_path, calls, wanted):
    for call in calls:
        call(recorder)
    summary = recorder.finish(10_000, ENDING)
    if "ends" in wanted:
        ends = read_starts(tmp_path / "run", scenario.area, [3])
        summary["ends"] = [(it.agent_id, it.north_m, it.primary, it.secondary) for it in ends]
    assert {key: summary[key] for key in wanted} == wanted
    assert (summary["uptime_paper"] is None) is summary.get("uptime_missing", "").startswith("no truth was")


def test_after_a_day_samples_are_as_rare_as_the_scenario_says(tmp_path, scenario):
    rare = replace(scenario, records=replace(scenario.records, record_period_s=10.0))
    recorder = Recorder(new_directory(tmp_path / "run"), rare, [3])
    recorder.truths([hand_made(0)])
    for now_ms in range(DAY_MS - 5000, DAY_MS + 25_001, 1000):
        at(now_ms)(recorder)
    recorder.close()
    with Reader(recorder._bag.path) as reader:
        stamps = [stamp_ns // 1_000_000 - DAY_MS for _, stamp_ns, _ in reader.messages()]
    assert stamps == [-5000, -4000, -3000, -2000, -1000, 0, 10_000, 20_000]


@pytest.mark.parametrize("buoyancy", Buoyancy)
def test_depth_in_the_bag_is_the_bodys(scenario, buoyancy):
    water_config = fleet_parts.fleet_config(flight_config(scenario)).maker().config(3).water
    still = hand_made(0).physical
    physical = replace(still, depth_anchor_ms=10_000, depth_um=1_234_567, buoyancy=buoyancy)
    water, body = TruthExtrapolator(scenario), Body(3, water_config, physical, 10_000)
    for now_ms in (10_000, 10_001, 33_333, 60_000, 90_000):
        assert water.depth_um(physical, now_ms) == body.depth_at_um(now_ms)


def test_a_disk_that_takes_no_more_is_one_error_and_the_records_are_whole(recorder, files_of_at_most):
    for second in range(1, 40):
        recorder.event(1000 * second, ScriptReported("x" * 400))
        at(1000 * second)(recorder)
    with files_of_at_most(recorder._directory.journal.stat().st_size + 100):
        recorder.event(40_000, ScriptReported("x" * 400))
        with pytest.raises(RecordsFailed, match=f"the disk of {recorder._directory.path} takes no more"):
            at(40_000)(recorder)
        recorder.event(41_000, ScriptReported("x"))
        at(41_000)(recorder)
    recorder.close()
    assert_whole(recorder._directory.path)


def assert_whole(path):
    """The records of 39 s."""
    contents = read_journal(path / "journal.jsonl")
    assert (contents.dropped, contents.last_ms) == (0, 39_000)
    with Reader(path / "run.bag"):
        pass


@pytest.mark.parametrize("fate", ["deleted", "moved", "replaced"])
def test_a_directory_that_is_gone_is_noticed_at_the_next_tick_and_named(recorder, tmp_path, fate):
    path, moved = recorder._directory.path, tmp_path / "elsewhere"
    for second in range(1, 40):
        at(1000 * second)(recorder)
    shutil.rmtree(path) if fate == "deleted" else path.rename(moved)
    if fate == "replaced":
        shutil.copytree(moved, path)
    what = "deleted" if fate == "deleted" else f"moved to {moved / 'journal.jsonl'}"
    words = f"^{path / 'journal.jsonl'} was {what} while the run flew: the run ends"
    with pytest.raises(RecordsFailed, match=words) as failed:
        at(40_000)(recorder)
    assert failed.value.reason is EndReason.RECORDS_GONE
    recorder.close()
    if fate != "deleted":
        assert_whole(moved)


def test_a_summary_is_written_though_an_aMussel_is_on_no_chart(recorder, monkeypatch):
    too_far = ValueError("too far from the origin for a local plane: north 1e9 m, east 0 m")
    monkeypatch.setattr("apad_bridge.records.recorder.save_starts", Mock(side_effect=too_far))
    recorder.truths([hand_made(7)])
    summary = recorder.finish(1000, Ending(MissionEnd(EndReason.MISSION_TIME), 0.0, 0.0, 0, None, {}))
    assert json.loads(recorder._directory.summary.read_text()) == summary
    (reason,) = summary["dropped"]
    assert reason.startswith("ends.csv: too far from the origin")


def test_a_sample_that_could_not_be_written_is_not_kept(tmp_path, files_of_at_most):
    file = SampleFile(tmp_path / "samples.jsonl", TimeScale(30))
    record = SampleRecord(3, 60_000, (1, 2, 3, 4), 0)
    with files_of_at_most(50), pytest.raises(OSError):
        file.append(SampleSource(7), [PlacedSample(record, None)])
    assert file.kept[SampleSource(7)] == set()
    file.append(SampleSource(7), [PlacedSample(record, None)])
    file.close()
    assert SampleFile(tmp_path / "samples.jsonl", TimeScale(30)).kept == {SampleSource(7): {3}}


def test_the_samples_of_a_real_one_stand_beside_those_of_the_simulated_one(recorder):
    for change in (None, Presence.REAL, Presence.SIMULATED):
        if change is not None:
            recorder.event(5000, PresenceChanged(7, change, "/lab"))
        recorder.samples(7, [PlacedSample(SampleRecord(0, 60_000, (1, 2, 3, 4), 0), None)])
    recorder.close()
    kept = {SampleSource(7): {0}, SampleSource(7, 5000): {0}}
    assert recorder.samples_kept == SampleFile(recorder._directory.samples, TimeScale(30)).kept == kept
    assert [it.columns.get("real_since_ms") for it in read_samples(recorder._directory.samples)] == [
        None,
        5000,
    ]


def test_a_sample_in_a_file_that_somebody_took_away_is_not_kept(recorder):
    recorder.samples(7, [PlacedSample(SampleRecord(0, 60_000, (1, 2, 3, 4), 0), None)])
    recorder._directory.samples.rename(recorder._directory.path / "taken.jsonl")
    with pytest.raises(RecordsFailed, match=r"samples\.jsonl was moved to .*taken\.jsonl") as failed:
        recorder.samples(7, [PlacedSample(SampleRecord(1, 60_000, (1, 2, 3, 4), 0), None)])
    assert failed.value.reason is EndReason.RECORDS_GONE and recorder.samples_kept == {SampleSource(7): {0}}


def test_a_sample_is_on_disk_before_it_is_kept(tmp_path, monkeypatch):
    synced = []

    def sync(descriptor):
        path = Path(os.readlink(f"/proc/self/fd/{descriptor}"))
        synced.append(
            (
                path.name,
                path.read_text().count("\n") if path.is_file() else 0,
                len(file.kept[SampleSource(7)]),
            )
        )

    monkeypatch.setattr("os.fsync", sync)
    file = SampleFile(tmp_path / "samples.jsonl", TimeScale(30))
    file.append(
        SampleSource(7), [PlacedSample(SampleRecord(n, 60_000, (1, 2, 3, 4), 0), None) for n in range(2)]
    )
    file.append(SampleSource(7), [PlacedSample(SampleRecord(2, 60_000, (1, 2, 3, 4), 0), None)])
    assert synced == [(tmp_path.name, 0, 0), ("samples.jsonl", 2, 0), ("samples.jsonl", 3, 2)]
