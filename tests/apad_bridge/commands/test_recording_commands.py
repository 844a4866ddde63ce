"""What the vehicle's own computer records: the aPad's topics and the mission's, and not the aMussels'."""

from __future__ import annotations

import re
import shlex

import pytest
from scenario_files import POOL_FILE

from apad_bridge.commands.prepare.run_preflight import recording_commands
from apad_bridge.scenario.loader import from_data, load, resolve


def topics_of(command: str) -> re.Pattern[str]:
    words = shlex.split(command)
    assert words[:2] == ["rosbag", "record"]
    return re.compile(words[words.index("-e") + 1])


@pytest.mark.parametrize(("namespace", "before"), [("", ""), ("basin", "/basin")])
def test_one_apad(namespace: str, before: str) -> None:
    (command,) = recording_commands(load(POOL_FILE), namespace)
    assert "-O apad1.bag" in command
    recorded = topics_of(command)
    for name in ("apad1/position", "apad1/goto_status", "musselbed/mission", "musselbed/beliefs"):
        assert recorded.fullmatch(f"{before}/{name}"), name
    for name in ("amussel1/position", "musselbed/markers", "musselbed/heard", "apad11/position"):
        assert not recorded.fullmatch(f"{before}/{name}"), name


def test_each_of_several_apads_has_its_own() -> None:
    data = resolve(load(POOL_FILE))
    data["apads"] = [{"name": "apad2", "start_m": [1, 1]}]
    commands = recording_commands(from_data(data, "several"), "")
    first, second = map(topics_of, commands)
    assert first.fullmatch("/musselbed/apad1/mission") and not first.fullmatch("/musselbed/apad2/mission")
    assert second.fullmatch("/apad2/position") and second.fullmatch("/musselbed/apad2/beliefs")
