"""Programs of somebody's that listen to a mission early and with a queue hear each of its events, in order."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest
from journals import lines_in
from patient import PATIENCE_S
from rosbags.rosbag1 import Reader

from apad_bridge.records.bag_samples import definitions_in
from apad_bridge.ros.system.master import Master, loopback_environment, start_master
from apad_bridge.scenario import loader

pytestmark = pytest.mark.system
ROOT = Path(__file__).parents[2]
COMMAND = (sys.executable, "-m", "apad_bridge.commands.main")
SETUP = f"source '{ROOT}/launch_scripts/setup.bash'; export ROS_PACKAGE_PATH=$ROS_PACKAGE_PATH:/usr/share"
"""For rosnodejs, which looks for Debian's definitions on this path alone."""
LISTENERS = {
    "rospy": [sys.executable, "-m", "tests.system.hear_mission"],
    "rosnodejs": ["bash", "-c", f"{SETUP}; exec node '{ROOT}/tests/system/hear_mission.js'"],
}
UNTOLD = ("run", "end")
"""The journal's and the bag's first and last lines: the node begins later, and ends before."""


def has_rosnodejs() -> bool:
    """True where Node finds it: by NODE_PATH, for example."""
    if shutil.which("node") is None:
        return False
    return subprocess.run(["node", "-e", "require.resolve('rosnodejs')"], capture_output=True).returncode == 0


@pytest.fixture
def master(tmp_path: Path) -> Iterator[Master]:
    running = start_master(tmp_path / "ros", timeout_s=120, orphan_s=60)
    yield running
    running.stop()


@pytest.mark.parametrize("client", LISTENERS)
def test_who_listens_early_hears_each_event_as_the_bag_has_it(
    client: str, tmp_path: Path, master: Master
) -> None:
    if client == "rosnodejs" and not has_rosnodejs():
        pytest.skip("node finds no rosnodejs: npm install rosnodejs, and NODE_PATH")
    data = loader.resolve(loader.load(ROOT / "launch_scripts" / "scenarios" / "real-apad.yaml"))
    data |= {"duration_s": 20.0}
    data["apad"] |= {"generation": "a", "start_m": [14, 10.5]}
    data["fleet"]["start"] = {"charge": [0.5, 0.7]}
    scenario, out = tmp_path / "scenario.yaml", tmp_path / "run"
    loader.write_resolved(scenario, loader.from_data(data, "pool"))
    environment = loopback_environment(tmp_path / "ros", master.uri)
    pipe = subprocess.PIPE
    with ExitStack() as stack:

        def start(*words: str) -> subprocess.Popen[str]:
            child = subprocess.Popen(
                words, cwd=ROOT, env=environment, stdin=pipe, stdout=pipe, stderr=pipe, text=True
            )
            stack.callback(child.communicate, timeout=PATIENCE_S)
            stack.callback(child.terminate)
            return child

        vehicle = start(*COMMAND, "apad", str(scenario))
        assert vehicle.stdout is not None and vehicle.stdout.readline() == "ready\n"
        listener = start(*LISTENERS[client])
        assert listener.stdout is not None
        assert any(line == "listening\n" for line in listener.stdout), "it does not listen"
        words = [
            "run",
            str(scenario),
            "--apad",
            "ros",
            "--hosting",
            "one_process",
            "--out",
            str(out),
            "--json",
        ]
        flight = start(*COMMAND, *words)
        _, errors = flight.communicate(timeout=PATIENCE_S)
        assert flight.returncode == 0, errors
        said, errors = listener.communicate(timeout=PATIENCE_S)
    heard = [tuple(it) for it in json.loads(said.splitlines()[-1])]
    assert heard == [it for it in events_in(out / "run.bag") if it[1] not in UNTOLD], errors
    kinds = {kind for _, kind in heard}
    assert {"plan", "primitive", "mission"} <= kinds
    # What passes between the supervisor and each aMussel is in the journal alone.
    assert any(it["kind"] == "stimulus" for it in lines_in(out / "journal.jsonl"))


def events_in(bag: Path) -> list[tuple[int, str]]:
    """(mission time, kind) of each event of the mission, in order."""
    with Reader(bag) as reader:
        wanted = [it for it in reader.connections if it.topic == "/musselbed/mission"]
        types = definitions_in(bag, wanted)
        messages = [types.deserialize_ros1(raw, it.msgtype) for it, _, raw in reader.messages(wanted)]
    return [(it.mission_time_ms, it.kind) for it in messages]
