"""What holds an aPad when the bench falls silent: on the vehicle's side, with the machine's own Python."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest
from older_pythons import NoOlderPython, older_python
from programs import ROOT, Begin, done, ended_well, line_of, with_helpers
from scenario_files import write_scenario

from apad_bridge.ros.simulated_node.apad_process import start_apad_node
from apad_bridge.ros.system.master import Master, end_process, loopback_environment

pytestmark = pytest.mark.system
WATCHDOG = ROOT / "launch_scripts" / "vehicle_watchdog"
PREEMPTED = 2
DRIFT_M_S = (0.05, -0.1)
DRIFT_S = 15
Play = Callable[..., dict[str, Any]]


@pytest.fixture
def told_by(tmp_path: Path, master: Master, begin: Begin) -> Iterator[Play]:
    """The report of a mission that falls silent, with the vehicle's own node and a watchdog that `python` runs."""
    with ExitStack() as stack:

        def play(generation: str, name: str, python: str = "/usr/bin/python3") -> dict[str, Any]:
            apad = {"generation": generation, "drift_m_s": list(DRIFT_M_S)}
            scenario = write_scenario(tmp_path / "silent.yaml", apad=apad)
            stack.callback(end_process, start_apad_node(scenario, master.uri, tmp_path / "apad.log"))
            command = (sys.executable, "-m", "tests.system.fall_silent", WATCHDOG, generation, name, python)
            environment = with_helpers(loopback_environment(tmp_path / "ros", master.uri))
            mission = begin(*command, env=environment, stdin=subprocess.PIPE, ends_by=signal.SIGKILL)
            if name == "lost":
                assert line_of(mission) == "end the master"
                master.stop()
                assert mission.stdin is not None
                mission.stdin.write("it has ended\n")
                mission.stdin.flush()
            told: dict[str, Any] = json.loads(ended_well(mission)[0].splitlines()[-1])
            return told

        yield play


@pytest.mark.parametrize(("generation", "version"), [("a", "2.7"), ("b", "3.8")])
def test_an_apad_whose_mission_falls_silent_is_held_where_it_is_and_a_pilot_is_not_fought(
    told_by: Play, generation: str, version: str
) -> None:
    """By a Python as vehicles have it, or by this machine's where there is no other."""
    try:
        python = older_python(version)
    except NoOlderPython:
        python = "/usr/bin/python3"
    told = told_by(generation, "silent", python)
    assert told["hears"] == ["WATCHING"] and told["hears_again"] == ["WATCHING"]
    assert "SILENT" in told["falls_silent"] and told["falls_silent"][-1].startswith("HELD at ")
    # Nobody held it, it would be 0.75 m north and 1.5 m west of there after that time.
    assert told["status"] == PREEMPTED and told["drifted_m"] == pytest.approx([0.0, 0.0], abs=0.5)
    assert told["piloted"][-2:] == ["SILENT", "PILOTED"]


@pytest.mark.parametrize("generation", ["a", "b"])
def test_without_a_master_it_is_held_and_at_a_bad_position_it_loses_its_thrust_until_heartbeats_come(
    told_by: Play, generation: str
) -> None:
    told = told_by(generation, "lost")
    assert told["falls_silent"][-1].startswith("HELD at ")
    assert told["status"] == PREEMPTED and told["drifted_m"] == pytest.approx([0.0, 0.0], abs=0.5)
    assert told["is_blind"][-2:] == ["SILENT", "OFF: the aPad's position is not finite"]
    assert told["off_m"] == pytest.approx([DRIFT_S * it for it in DRIFT_M_S], abs=0.3)
    assert told["stays"] == "OFF"


def test_it_says_how_it_is_used_and_imports_nothing_of_ours() -> None:
    text = WATCHDOG.read_text()
    assert not any(room in text for room in ("apad_bridge", "musselbed_msgs", "firmware_model"))
    for words, told in (
        (("--silence-s", "0"), "--silence-s must be 1 or more"),
        (("--home", "1", "2"), "--home needs --fence, --home-percent"),
        (("--home", "1", "2", "--home-percent", "30", "--fence", "0,0 1,1"), "three corners or more"),
    ):
        assert told in done("/usr/bin/python3", WATCHDOG, *words, code=2).stderr


def test_a_shell_without_ros_gets_the_help_and_one_line_with_the_mend() -> None:
    bare = ["/usr/bin/python3", "-I", "-S", str(WATCHDOG)]
    assert "--silence-s" in done(*bare, "--help").stdout
    refused = done(*bare, code=2)
    assert "python3 has no ROS (No module named 'roslib'): source the setup.bash" in refused.stderr
