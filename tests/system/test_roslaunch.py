"""The launch files: what they would start, and one short flight on roslaunch's own master."""

from __future__ import annotations

import json
import os
import random
import shutil
import signal
import socket
import subprocess
import sys
from contextlib import suppress
from pathlib import Path

import pytest
import yaml

from apad_bridge.ros.system.master import loopback_environment, start_master
from apad_bridge.scenario.loader import load

pytestmark = pytest.mark.system
ROOT = Path(__file__).parents[2]
LAUNCH = ROOT / "launch_scripts"
PATIENCE_S = 300.0
"""A busy machine needs minutes to start a launch file's dozen of processes."""
SHIPPED = ["pool-12", "bay-24", "no-charging", "demo", "bay-120"]

FLEET_ONLY = {"/musselbed"}
WITH_THE_SIMULATED_APAD = FLEET_ONLY | {"/musselbed_clock", "/apad1_simulated"}
WITH_FIVE = WITH_THE_SIMULATED_APAD | {f"/apad{number}_simulated" for number in range(2, 6)}


@pytest.fixture
def environment(tmp_path: Path) -> dict[str, str]:
    """Of a shell in `tmp_path` that found our package, in which musselbed's Python stands first."""
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    return loopback_environment(tmp_path / "ros") | {
        "ROS_PACKAGE_PATH": str(LAUNCH),
        "PATH": path,
        "PWD": str(tmp_path),
    }


def a_port() -> str:
    """A free port for a master that binds it a second later, which no other process is given meanwhile: one below those
    that the kernel hands out."""
    first = int(Path("/proc/sys/net/ipv4/ip_local_port_range").read_text().split()[0])
    while True:
        port = random.SystemRandom().randrange(max(1024, first - 16_000), first)
        with suppress(OSError), socket.create_server(("127.0.0.1", port)):
            return str(port)


def roslaunch(environment: dict[str, str], *arguments: str) -> str:
    """Returns the text of both outputs."""
    with subprocess.Popen(
        ["roslaunch", *arguments],
        env=environment,
        cwd=environment["PWD"],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    ) as launched:
        try:
            said, _ = launched.communicate(timeout=PATIENCE_S)
        except subprocess.TimeoutExpired:
            launched.send_signal(signal.SIGINT)  # it ends its nodes, which a kill would leave over
            said, _ = launched.communicate(timeout=PATIENCE_S)
            raise AssertionError(f"it still ran after {PATIENCE_S:g} s: {said}") from None
    assert launched.returncode == 0, said
    return said


SHOW = """
import sys, roslaunch
for option in (["--nodes"], ["--dump-params"], ["--args", "/musselbed"]):
    roslaunch.main(["roslaunch", *option, *sys.argv[1:]])
    print("---")
"""


def shown_by_roslaunch(environment: dict[str, str], *arguments: str) -> list[str]:
    """The nodes, the parameters and our node's command, as roslaunch tells them of a launch file."""
    done = subprocess.run(
        ["/usr/bin/python3", "-c", SHOW, *arguments],
        env=environment,
        cwd=environment["PWD"],
        capture_output=True,
        text=True,
        timeout=PATIENCE_S,
    )
    assert done.returncode == 0, done.stderr
    nodes, parameters, command, _ = done.stdout.split("---\n")
    return [nodes, parameters, command]


@pytest.mark.parametrize("name", SHIPPED)
def test_what_a_launch_file_starts(name: str, environment: dict[str, str]) -> None:
    nodes, parameters, told = shown_by_roslaunch(environment, "musselbed", f"{name}.launch")
    assert set(nodes.split()) == (WITH_FIVE if name == "bay-120" else WITH_THE_SIMULATED_APAD)
    assert yaml.safe_load(parameters) == {"/use_sim_time": True}
    command = told.split()
    flown = "pool-12" if name == "demo" else name
    assert f"{LAUNCH}/scenarios/{flown}.yaml" in command
    scenario = load(LAUNCH / "scenarios" / f"{flown}.yaml")
    for option, value in {
        "--theta": scenario.theta,
        "--agents": scenario.fleet.count,
        "--strategy": scenario.mission.collection,
    }.items():
        assert command[command.index(option) + 1] == str(value), (
            "the launch file flies another scenario than the YAML"
        )


@pytest.mark.parametrize("name", SHIPPED)
def test_with_an_aPad_of_somebody_elses_time_is_left_alone(name: str, environment: dict[str, str]) -> None:
    arguments = ("musselbed", f"{name}.launch", "simulate_apad:=false")
    nodes, parameters, command = shown_by_roslaunch(environment, *arguments)
    assert set(nodes.split()) == FLEET_ONLY
    assert "use_sim_time" not in parameters
    assert "--apad ros --time wall" in command and "speed" not in command


def test_a_short_flight_on_roslaunchs_master(tmp_path: Path, environment: dict[str, str]) -> None:
    data = yaml.safe_load((LAUNCH / "scenarios" / "pool-12.yaml").read_text())
    shutil.copy(LAUNCH / "scenarios" / "pool-12.csv", tmp_path)
    data |= {"name": "short", "duration_s": 20}
    (tmp_path / "short.yaml").write_text(yaml.safe_dump(data))
    arguments = (f"scenario:={tmp_path / 'short.yaml'}", "speed:=10", "agents:=4", "options:=--seed 3")
    told = roslaunch(environment, "-p", a_port(), "musselbed", "fly.launch", *arguments)
    (summary_file,) = [*tmp_path.glob("runs/short-*/summary.json"), None][:1]
    assert summary_file is not None, told
    summary = json.loads(summary_file.read_text())
    assert (summary["ended_by"], summary["agents"], summary["seed"]) == ("mission time", 4, 3)
    assert "process has finished cleanly" in told


def test_five_aPads_on_roslaunchs_master(tmp_path: Path, environment: dict[str, str]) -> None:
    data = yaml.safe_load((LAUNCH / "scenarios" / "bay-120.yaml").read_text())
    # Two aMussels beside each aPad, one that wants charging and one that does not.
    rows = [f"{n},30,{40 * ((n - 1) // 2) + 20 + n % 2},{0.75 if n % 2 else 0.95}" for n in range(1, 11)]
    (tmp_path / "ten.csv").write_text("\n".join(["id,north,east,battery", *rows]) + "\n")
    data |= {"name": "five", "duration_s": 30}
    data["fleet"]["start"] = "ten.csv"
    data["fleet"]["count"] = 10
    data["mission"]["batch"] = 1
    (tmp_path / "five.yaml").write_text(yaml.safe_dump(data))
    arguments = (f"scenario:={tmp_path / 'five.yaml'}", "speed:=4", "agents:=10", "theta:=300")
    told = roslaunch(environment, "-p", a_port(), "musselbed", "bay-120.launch", *arguments)
    (summary_file,) = [*tmp_path.glob("runs/five-*/summary.json"), None][:1]
    assert summary_file is not None, told
    summary = json.loads(summary_file.read_text())
    assert (summary["agents"], len(summary["apads"])) == (10, 5), told
    # Each flew an aPad of its own: all took the first aMussel, which lies 1 m from where that aPad starts.
    for name, own in summary["apads"].items():
        assert own["ended_by"] == "mission time", name
        assert own["planned_m"] == pytest.approx(1.0, abs=0.05), name


def test_a_second_clock_is_refused(tmp_path: Path) -> None:
    master = start_master(tmp_path / "ros", timeout_s=120, orphan_s=0)
    environment = loopback_environment(tmp_path / "ros", master.uri)
    first = [
        sys.executable,
        "-c",
        "import rospy, sys; from rosgraph_msgs.msg import Clock\n"
        "rospy.init_node('theirs', disable_signals=True); rospy.Publisher('/clock', Clock, queue_size=1)\n"
        "print('ready', flush=True); sys.stdin.read(); rospy.signal_shutdown('')",
    ]
    try:
        with subprocess.Popen(
            first, env=environment, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        ) as theirs:
            assert theirs.stdout is not None and theirs.stdout.readline() == "ready\n"
            command = [sys.executable, "-m", "apad_bridge.ros.system.clock_node"]
            second = subprocess.run(
                command, env=environment, cwd=ROOT, capture_output=True, text=True, timeout=PATIENCE_S
            )
            theirs.communicate(timeout=180)
    finally:
        master.stop()
    assert second.returncode == 3
    assert "/clock comes from /theirs already" in second.stderr


TOLD = """
import os, sys
print("told", sys.argv[1:], flush=True)
print("in", os.environ["ROS_NAMESPACE"], flush=True)
"""
LAUNCHED = """
<launch>
  <group ns="basin">
    <node pkg="musselbed" type="ros_node" name="told" required="true" output="screen"
          args="{folder} told run --seed 3">
      <param name="theta" value="60"/>
      <param name="manual" value="true"/>
      <rosparam param="open_modem">[3, 7]</rosparam>
      <remap from="/apad1/position" to="/boat/position"/>
    </node>
  </group>
</launch>
"""


def test_remaps_and_private_parameters_of_a_launch_file_become_options(
    tmp_path: Path, environment: dict[str, str]
) -> None:
    (tmp_path / "told.py").write_text(TOLD)
    (tmp_path / "told.launch").write_text(LAUNCHED.format(folder=tmp_path))
    said = roslaunch(environment, "-p", a_port(), str(tmp_path / "told.launch"))
    words = ["run", "--seed", "3", "--remap", "/apad1/position:=/boat/position"]
    assert f"told {[*words, '--manual', '--open-modem', '3', '--open-modem', '7', '--theta', '60']}" in said
    assert "in /basin" in said


def test_a_namespace_by_hand(tmp_path: Path, environment: dict[str, str]) -> None:
    (tmp_path / "told.py").write_text(TOLD)
    command = [str(LAUNCH / "ros_node"), str(tmp_path), "told", "run", "__ns:=lab/basin", "a:=b"]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=PATIENCE_S)
    assert done.stdout == "told ['run', '--remap', 'a:=b']\nin lab/basin\n", done.stderr
