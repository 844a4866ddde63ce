"""The same packets of sound, with the same fates, whichever way a fleet is hosted and a vehicle reached."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
import yaml
from rosbags.rosbag1 import Reader

from apad_bridge.records.bag_messages import typestore
from apad_bridge.scenario.loader import load, resolve

pytestmark = pytest.mark.system

WHOLE_BOARDS = Path(__file__).parents[2] / "launch_scripts" / "scenarios" / "whole-board-12.yaml"


def scenario(folder: Path) -> Path:
    """An hour and a half of agent time in loud water: the aPad pings and assigns, the aMussels report, some is lost."""
    data = resolve(load(WHOLE_BOARDS))
    data.update(name="sound", duration_s=140)
    data["hearing"]["mode"] = "physical"
    data["water"] = {
        "sound": {"noise_db_per_hz": 109.0, "fading_db": 3.0},
        "talk": {"assigns": True, "beacon_period_s": 3600},
    }
    path = folder / "sound.yaml"
    path.write_text(yaml.safe_dump(data, sort_keys=False))
    return path


def packets(path: Path, out: Path, *options: str) -> list[dict[str, Any]]:
    command = [
        sys.executable,
        "-m",
        "apad_bridge.commands.main",
        "run",
        str(path),
        "--out",
        str(out),
        "--json",
    ]
    subprocess.run([*command, *options], check=True, capture_output=True, timeout=300)
    lines = [json.loads(line) for line in (out / "journal.jsonl").read_text().splitlines()]
    return [line for line in lines if line["kind"] == "packet"]


def test_in_memory_and_by_processes_over_ros_the_packets_are_the_same(tmp_path: Path) -> None:
    path = scenario(tmp_path)
    here = packets(path, tmp_path / "here", "--time", "asap", "--hosting", "one_process")
    outcomes = {row[1] for packet in here for row in packet["heard"]}
    assert {"received", "noise"} <= outcomes and len(here) > 60
    assert packets(path, tmp_path / "ros", "--time", "wall", "--speed", "40") == here
    told = []
    with Reader(tmp_path / "ros" / "run.bag") as reader:
        for connection, _, data in reader.messages():
            if connection.topic == "/musselbed/sound":
                message: Any = typestore().deserialize_ros1(data, connection.msgtype)
                told.append((message.sender, message.listener_id, message.message.split()[0]))
    assert told == [(packet["from"], row[0], row[1]) for packet in here for row in packet["heard"]]
