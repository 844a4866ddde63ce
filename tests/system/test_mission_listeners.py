"""Programs of somebody's that listen to a mission early and with a queue hear each of its events, in order."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from programs import MUSSELBED, ROOT, Begin, ended_well, line_of, lines_of
from rosbags.rosbag1 import Reader
from scenario_files import write_scenario

from apad_bridge.records.bag_samples import definitions_in

pytestmark = pytest.mark.system
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


@pytest.mark.parametrize("client", LISTENERS)
def test_who_listens_early_hears_each_event_as_the_bag_has_it(
    client: str, tmp_path: Path, shell: dict[str, str], begin: Begin
) -> None:
    if client == "rosnodejs" and not has_rosnodejs():
        pytest.skip("node finds no rosnodejs: npm install rosnodejs, and NODE_PATH")
    scenario = write_scenario(
        tmp_path / "pool.yaml",
        ROOT / "launch_scripts" / "scenarios" / "real-apad.yaml",
        duration_s=10.0,
        apad={"generation": "a", "start_m": [14, 10.5]},
        fleet={"start": {"charge": [0.5, 0.7]}},
    )
    out, there = tmp_path / "run", {"env": shell, "stdin": subprocess.PIPE}
    assert line_of(begin(*MUSSELBED, "apad", scenario, **there)) == "ready"
    listener = begin(*LISTENERS[client], **there)
    assert listener.stdout is not None
    assert any(line == "listening\n" for line in listener.stdout), "it does not listen"
    fly = ("run", scenario, "--apad", "ros", "--hosting", "one_process", "--out", out, "--json")
    ended_well(begin(*MUSSELBED, *fly, **there))
    said, errors = listener.communicate()
    heard = [tuple(it) for it in json.loads(said.splitlines()[-1])]
    assert heard == [it for it in events_in(out / "run.bag") if it[1] not in UNTOLD], errors
    assert {"plan", "primitive", "mission"} <= {kind for _, kind in heard}
    # What passes between the supervisor and each aMussel is in the journal alone.
    assert lines_of(out, "stimulus")


def events_in(bag: Path) -> list[tuple[int, str]]:
    """(mission time, kind) of each event of the mission, in order."""
    with Reader(bag) as reader:
        wanted = [it for it in reader.connections if it.topic == "/musselbed/mission"]
        types = definitions_in(bag, wanted)
        messages = [types.deserialize_ros1(raw, it.msgtype) for it, _, raw in reader.messages(wanted)]
    return [(it.mission_time_ms, it.kind) for it in messages]
