"""Another party commands a real aPad of generation A, which here is a simulated one on somebody else's master."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import pytest
from programs import MUSSELBED, ROOT, Begin, ended_well, line_of
from scenario_files import write_scenario

from apad_bridge.ros.system.master import Master, loopback_environment

pytestmark = pytest.mark.system
SUCCEEDED = 3


def test_a_mission_stands_aside_for_anothers_go_to_until_it_is_given_back(
    tmp_path: Path, master: Master, begin: Begin
) -> None:
    scenario = write_scenario(
        tmp_path / "pool.yaml",
        ROOT / "launch_scripts" / "scenarios" / "real-apad.yaml",
        apad={"generation": "a", "start_m": [14, 10.5]},
        mission={"speed_m_s": 0.8},
    )
    there = {"env": loopback_environment(tmp_path / "ros", master.uri)}
    assert line_of(begin(*MUSSELBED, "apad", scenario, **there)) == "ready"
    # A near place: a mission lets the other's order end for a minute, which is short where machines are busy.
    somebody = begin(sys.executable, "-m", "tests.system.send_away", 17.0, 10.5, **there)
    assert line_of(somebody) == "listening"
    fly = ("--apad", "ros", "--hosting", "one_process", "--out", tmp_path / "run", "--json")
    begin(*MUSSELBED, "run", scenario, *fly, **there)
    told = json.loads(ended_well(somebody)[0])
    assert told["state"] == SUCCEEDED, "the other's go-to was cut short"
    assert told["away_m"] < 1.0, "the mission took the aPad back by itself"
    assert told["given_back"]
    assert "plan" not in told["aside"]
