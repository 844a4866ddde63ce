"""What holds an aPad when the bench falls silent: on the vehicle's side, with the machine's own Python."""

from __future__ import annotations

import json
import subprocess
import sys
from contextlib import ExitStack
from pathlib import Path

import pytest
from scenario_files import POOL_FILE

from apad_bridge.ros.simulated_node.apad_process import start_apad_node, stop_apad_node
from apad_bridge.ros.system.master import loopback_environment, start_master
from apad_bridge.scenario import loader

pytestmark = pytest.mark.system
ROOT = Path(__file__).parents[2]
WATCHDOG = ROOT / "launch_scripts" / "vehicle_watchdog"
PREEMPTED = 2


@pytest.mark.parametrize("generation", ["a", "b"])
def test_an_apad_whose_mission_falls_silent_is_held_where_it_is_and_a_pilot_is_not_fought(
    tmp_path: Path, generation: str
) -> None:
    data = loader.resolve(loader.load(POOL_FILE))
    data["apad"] |= {"generation": generation, "drift_m_s": [0.05, -0.1]}
    scenario = tmp_path / "scenario.yaml"
    loader.write_resolved(scenario, loader.from_data(data, "silent"))
    with ExitStack() as stack:
        master = start_master(tmp_path / "ros", timeout_s=120, orphan_s=120)
        stack.callback(master.stop)
        stack.callback(stop_apad_node, start_apad_node(scenario, master.uri, tmp_path / "apad.log"))
        done = subprocess.run(
            [sys.executable, "-m", "tests.system.fall_silent", str(WATCHDOG), generation],
            env=loopback_environment(tmp_path / "ros", master.uri),
            cwd=ROOT,
            capture_output=True,
            text=True,
            timeout=300,
        )
    assert done.returncode == 0, done.stderr
    told = json.loads(done.stdout.splitlines()[-1])
    assert told["hears"] == ["WATCHING"] and told["hears_again"] == ["WATCHING"]
    assert told["falls_silent"][0] == "SILENT" and told["falls_silent"][-1].startswith("HELD at ")
    # Nobody held it, it would be 1.5 m north and 3 m west of there after half a minute.
    assert told["status"] == PREEMPTED and told["drifted_m"] == pytest.approx([0.0, 0.0], abs=0.5)
    assert told["piloted"] == ["SILENT", "PILOTED"]


def test_it_says_how_it_is_used_and_imports_nothing_of_ours() -> None:
    text = WATCHDOG.read_text()
    assert not any(room in text for room in ("apad_bridge", "musselbed_msgs", "firmware_model"))
    for words, told in (
        (("--silence-s", "0"), "--silence-s must be 1 or more"),
        (("--home", "1", "2"), "--home needs --fence, --home-percent"),
        (("--home", "1", "2", "--home-percent", "30", "--fence", "0,0 1,1"), "three corners or more"),
    ):
        refused = subprocess.run(
            ["/usr/bin/python3", str(WATCHDOG), *words], capture_output=True, text=True, timeout=180
        )
        assert refused.returncode == 2 and told in refused.stderr


def test_a_shell_without_ros_gets_the_help_and_one_line_with_the_mend() -> None:
    bare = ["/usr/bin/python3", "-I", "-S", str(WATCHDOG)]
    helped = subprocess.run([*bare, "--help"], capture_output=True, text=True, timeout=180)
    assert helped.returncode == 0 and "--silence-s" in helped.stdout
    refused = subprocess.run(bare, capture_output=True, text=True, timeout=180)
    assert refused.returncode == 2
    assert "this shell has no ROS (No module named 'roslib'): source the setup.bash" in refused.stderr
