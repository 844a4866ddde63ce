"""Debian's own tools on a bag of ours: what rosbag says of it, and what rostopic reads in it."""

from __future__ import annotations

import csv
import os
import shutil
from datetime import UTC, datetime
from pathlib import Path

import pytest
from programs import done
from rosbags.rosbag1 import Reader
from scenario_files import POOL_FILE

from agents.mussel.outputs import Truth
from agents.mussel.physical import Physical
from agents.time_scale import MissionMs, TimeScale
from apad_bridge.beliefs.belief import Belief
from apad_bridge.events.mission_events import DockSwitched
from apad_bridge.records.bag import BagWriter
from apad_bridge.records.recorder import Recorder
from apad_bridge.records.run_directory import RunDirectory
from apad_bridge.records.samples import TruthSample
from apad_bridge.ros.types.generate import generate
from apad_bridge.scenario.loader import load
from apad_bridge.vehicle.commands import BatteryReported, PoseReported
from firmware_model.actions import Buoyancy
from firmware_model.power.charge import Battery, Flow, grains
from firmware_model.states import State

pytestmark = pytest.mark.system
TICKS = 10


@pytest.fixture(scope="module")
def messages(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("messages") / "ros"
    generate(folder)
    return folder


@pytest.fixture
def bag(tmp_path: Path) -> Path:
    """Ten ticks of one aMussel and the aPad, from time 0 on, and one event."""
    scenario = load(POOL_FILE)
    directory = RunDirectory.create("story", datetime(2026, 5, 4, tzinfo=UTC), tmp_path / "run")
    recorder = Recorder(directory, scenario, [7])
    battery = Battery(0, grains(0.5), Flow.RESTING)
    physical = Physical(battery, battery, 1_500_000, 2_500_000, 0, 0, Buoyancy.FLOAT, True)
    recorder.truths([Truth(0, 7, State.CHARGING, physical)])
    recorder.event(MissionMs(0), DockSwitched(0, 7, True))
    for now_ms in range(0, 1000 * TICKS, 1000):
        belief = Belief(7, now_ms, State.CHARGING, 0.5, 1.0, 1.5, 2.5)
        pose = PoseReported(now_ms, 1.0, 2.0, 0.25)
        recorder.tick(
            now_ms, [belief], pose, BatteryReported(now_ms, 15.5, 0.9), "hold position", (7, None, None, None)
        )
    recorder.close()
    return directory.path / "run.bag"


def tool(messages: Path, *words: object) -> str:
    """Debian's tools run /usr/bin/python3: they find our messages on these two paths only."""
    environment = os.environ | dict.fromkeys(("PYTHONPATH", "ROS_PACKAGE_PATH"), str(messages))
    return done("/usr/bin/env", *words, env=environment).stdout


def test_rosbag_knows_the_bag_and_finds_nothing_to_migrate(bag: Path, messages: Path) -> None:
    said = tool(messages, "rosbag", "info", bag)
    for topic, count, kind in (
        ("truth", f"{TICKS} msgs", "FleetTruth"),
        ("beliefs", f"{TICKS} msgs", "FleetBeliefs"),
        ("apad", f"{TICKS} msgs", "APadStatus"),
        ("mission", "1 msg", "MissionEvent"),
    ):
        (line,) = [line for line in said.splitlines() if f"/musselbed/{topic} " in line]
        assert line.split()[-4:] == [*count.split(), ":", f"musselbed_msgs/{kind}"]
    assert f"{3 * TICKS + 1}" in said and "9.0s" in said
    assert tool(messages, "rosbag", "check", bag) == "Bag file does not need any migrations.\n"


def test_rosbag_reindex_mends_a_bag_that_was_never_closed(tmp_path: Path, messages: Path) -> None:
    writer = BagWriter(tmp_path / "run.bag", TimeScale(30))
    for now_ms in range(0, 30_000, 1000):
        truth = TruthSample(7, State.ACTIVE, 0.25, 1.0, 1.0 + now_ms, 2.0, 3.0, False, 30 * now_ms)
        writer.sample(now_ms, [truth], [], None)
    torn = shutil.copy(writer.path, tmp_path / "torn.bag")  # what a kill leaves of it
    writer.close()
    tool(messages, "rosbag", "reindex", torn)
    # Chunks of seconds 0 to 10 and 11 to 20 are whole.
    said = tool(messages, "rosbag", "info", torn).splitlines()
    assert [line.split()[1] for line in said if line.startswith("messages:")] == ["21"]
    assert "100%" in tool(messages, "rosbag", "filter", torn, tmp_path / "all.bag", "True")
    with Reader(tmp_path / "all.bag") as bag:
        stamps_ns = [stamp_ns for _, stamp_ns, _ in bag.messages()]
    assert stamps_ns == [max(1, second * 10**9) for second in range(21)]


def test_rostopic_reads_every_tick(bag: Path, messages: Path) -> None:
    header, *rows = csv.reader(
        tool(messages, "rostopic", "echo", "-b", bag, "-p", "/musselbed/truth").splitlines()
    )
    fields = (
        "mission_time_ms",
        "agents0.id",
        "agents0.primary",
        "agents0.north",
        "agents0.docked",
        "agent_time_ms",
    )
    read = [dict(zip(header, row, strict=True)) for row in rows]
    assert [[it[f"field.{name}"] for name in fields] for it in read] == [
        [str(now_ms), "7", "0.5", "1.5", "1", str(30 * now_ms)] for now_ms in range(0, 1000 * TICKS, 1000)
    ]
