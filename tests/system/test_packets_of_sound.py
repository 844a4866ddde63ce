"""The same packets of sound, with the same fates, whichever way a fleet is hosted and a vehicle reached."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from programs import ROOT, lines_of, musselbed
from rosbags.rosbag1 import Reader
from scenario_files import write_scenario

from apad_bridge.records.bag_messages import typestore

pytestmark = pytest.mark.system


def test_in_memory_and_by_processes_over_ros_the_packets_are_the_same(tmp_path: Path) -> None:
    """An hour and a half of agent time in loud water: the aPad pings and assigns, the aMussels report, some is lost."""
    path = write_scenario(
        tmp_path / "sound.yaml",
        ROOT / "launch_scripts" / "scenarios" / "whole-board-12.yaml",
        duration_s=140,
        hearing={"mode": "physical"},
        water={
            "sound": {"noise_db_per_hz": 109.0, "fading_db": 3.0},
            "talk": {"assigns": True, "beacon_period_s": 3600},
        },
    )
    for name, *options in (("here", "--time", "asap", "--hosting", "one_process"), ("ros", "--speed", "40")):
        musselbed("run", path, *options, "--out", tmp_path / name, "--json")
    here, over_ros = (lines_of(tmp_path / it, "packet") for it in ("here", "ros"))
    outcomes = {row[1] for packet in here for row in packet["heard"]}
    assert {"received", "noise"} <= outcomes and len(here) > 60
    assert over_ros == here
    told = []
    with Reader(tmp_path / "ros" / "run.bag") as reader:
        for connection, _, data in reader.messages():
            if connection.topic == "/musselbed/sound":
                message: Any = typestore().deserialize_ros1(data, connection.msgtype)
                told.append((message.sender, message.listener_id, message.message.split()[0]))
    assert told == [(packet["from"], row[0], row[1]) for packet in here for row in packet["heard"]]
