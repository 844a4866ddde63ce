"""What holds an aPad when the bench falls silent: on the vehicle's side, with the machine's own Python."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from older_pythons import NoOlderPython, older_python
from programs import ROOT, Begin, done, line_of, with_helpers
from scenario_files import write_scenario

from apad_bridge.ros.simulated_node.apad_process import start_apad_node
from apad_bridge.ros.system.master import Master, end_process, loopback_environment

pytestmark = pytest.mark.system
WATCHDOG = ROOT / "launch_scripts" / "vehicle_watchdog"
PREEMPTED = 2
DRIFT_M_S = (0.05, -0.1)
DRIFT_S = 15


@pytest.mark.parametrize(("generation", "version"), [("a", "2.7"), ("b", "3.8")])
def test_an_apad_whose_mission_falls_silent_is_held_also_without_a_master_and_a_pilot_is_not_fought(
    generation: str, version: str, tmp_path: Path, master: Master, begin: Begin
) -> None:
    """By a Python as vehicles have it, or by this machine's where there is no other."""
    try:
        python = older_python(version)
    except NoOlderPython:
        python = "/usr/bin/python3"
    apad = {"generation": generation, "drift_m_s": list(DRIFT_M_S)}
    scenario = write_scenario(tmp_path / "silent.yaml", apad=apad)
    node = start_apad_node(scenario, master.uri, tmp_path / "apad.log")
    try:
        command = (sys.executable, "-m", "tests.system.fall_silent", WATCHDOG, generation, python)
        environment = with_helpers(loopback_environment(tmp_path / "ros", master.uri))
        mission = begin(*command, env=environment, stdin=subprocess.PIPE, ends_by=signal.SIGKILL)
        assert line_of(mission) == "end the master"
        master.stop()
        told = json.loads(mission.communicate("it has ended\n")[0].splitlines()[-1])
    finally:
        end_process(node)
    assert told["hears"] == ["WATCHING"] and told["hears_again"] == ["WATCHING"]
    assert told["piloted"][-2:] == ["SILENT", "PILOTED"]
    for held in (told["silent"], told["lost"]):
        assert "SILENT" in held["falls_silent"] and held["falls_silent"][-1].startswith("HELD at ")
        # Nobody held it, it would be 0.75 m north and 1.5 m west of there after that time.
        assert held["status"] == PREEMPTED and held["drifted_m"] == pytest.approx([0.0, 0.0], abs=0.5)
    # At a bad position it loses its thrust until heartbeats come.
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
