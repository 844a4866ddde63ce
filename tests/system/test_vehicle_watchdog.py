"""What holds an aPad when the bench falls silent: on the vehicle's side, with the machine's own Python."""

from __future__ import annotations

import json
import subprocess
import sys
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest
from older_pythons import NoOlderPython, older_python
from scenario_files import POOL_FILE

from apad_bridge.ros.simulated_node.apad_process import start_apad_node, stop_apad_node
from apad_bridge.ros.system.master import loopback_environment, start_master
from apad_bridge.scenario import loader

pytestmark = pytest.mark.system
ROOT = Path(__file__).parents[2]
WATCHDOG = ROOT / "launch_scripts" / "vehicle_watchdog"
PREEMPTED = 2
DRIFT_M_S = (0.05, -0.1)


def told_by(
    tmp_path: Path, generation: str, play: str, python: str = "/usr/bin/python3", **apad: Any
) -> dict[str, Any]:
    """The report of a mission that falls silent, with the vehicle's own node and a watchdog that `python` runs."""
    data = loader.resolve(loader.load(POOL_FILE))
    data["apad"] |= {"generation": generation, "drift_m_s": list(DRIFT_M_S)} | apad
    scenario = tmp_path / "scenario.yaml"
    loader.write_resolved(scenario, loader.from_data(data, "silent"))
    with ExitStack() as stack:
        master = start_master(tmp_path / "ros", timeout_s=120, orphan_s=120)
        stack.callback(master.stop)
        stack.callback(stop_apad_node, start_apad_node(scenario, master.uri, tmp_path / "apad.log"))
        mission = stack.enter_context(
            subprocess.Popen(
                [sys.executable, "-m", "tests.system.fall_silent", str(WATCHDOG), generation, play, python],
                env=loopback_environment(tmp_path / "ros", master.uri),
                cwd=ROOT,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=stack.enter_context((tmp_path / "mission.log").open("wb")),
                text=True,
            )
        )
        stack.callback(mission.kill)
        assert mission.stdin is not None and mission.stdout is not None
        lines = []
        for line in mission.stdout:
            lines.append(line)
            if line.strip() == "end the master":
                master.stop()
                mission.stdin.write("it has ended\n")
                mission.stdin.flush()
        assert mission.wait(60) == 0, (tmp_path / "mission.log").read_text()
    told: dict[str, Any] = json.loads(lines[-1])
    return told


@pytest.mark.parametrize(
    ("generation", "version"),
    [("a", ""), ("b", ""), ("a", "2.7"), ("b", "3.8")],
    ids=["a", "b", "a-python-2.7", "b-python-3.8"],
)
def test_an_apad_whose_mission_falls_silent_is_held_where_it_is_and_a_pilot_is_not_fought(
    tmp_path: Path, generation: str, version: str
) -> None:
    try:
        python = older_python(version) if version else "/usr/bin/python3"
    except NoOlderPython as error:
        pytest.skip(str(error))
    told = told_by(tmp_path, generation, "silent", python)
    assert told["hears"] == ["WATCHING"] and told["hears_again"] == ["WATCHING"]
    assert "SILENT" in told["falls_silent"] and told["falls_silent"][-1].startswith("HELD at ")
    # Nobody held it, it would be 1.5 m north and 3 m west of there after half a minute.
    assert told["status"] == PREEMPTED and told["drifted_m"] == pytest.approx([0.0, 0.0], abs=0.5)
    assert told["piloted"][-2:] == ["SILENT", "PILOTED"]


@pytest.mark.parametrize("generation", ["a", "b"])
def test_without_a_master_it_is_held_and_at_a_bad_position_it_loses_its_thrust_until_heartbeats_come(
    tmp_path: Path, generation: str
) -> None:
    told = told_by(tmp_path, generation, "lost")
    assert told["falls_silent"][-1].startswith("HELD at ")
    assert told["status"] == PREEMPTED and told["drifted_m"] == pytest.approx([0.0, 0.0], abs=0.5)
    assert told["is_blind"][-2:] == ["SILENT", "OFF: the aPad's position is not finite"]
    assert told["off_m"] == pytest.approx([30 * it for it in DRIFT_M_S], abs=0.3)
    assert told["stays"] == "OFF"


def test_a_vehicle_that_blocks_its_calls_while_it_docks_carries_out_no_backlog_of_holds(
    tmp_path: Path,
) -> None:
    told = told_by(tmp_path, "b", "blocked", fault="blocks")
    assert any(it.startswith("not ordered yet: ") and "no answer" in it for it in told["falls_silent"])
    assert told["falls_silent"][-1].startswith("HELD at ")
    assert told["blocked_ms"] >= 27_000  # at twice the wall's speed, in which it tried about ten times
    # A hold ended the docking. The next one is the repetition, because the first may have been an old one.
    assert told["ends"] == 2


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
