"""The launch files: what they would start, and one short flight on roslaunch's own master."""

from __future__ import annotations

import json
import os
import random
import signal
import socket
import subprocess
import sys
from contextlib import suppress
from pathlib import Path

import pytest
import yaml
from programs import ROOT, Begin, done, line_of
from scenario_files import write_scenario

from apad_bridge.ros.system.master import Master, loopback_environment
from apad_bridge.scenario.loader import load

pytestmark = pytest.mark.system
LAUNCH = ROOT / "launch_scripts"
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


def roslaunch(begin: Begin, environment: dict[str, str], *arguments: str | Path) -> str:
    """Returns the text of both outputs. One that does not end is told to end its nodes, which a kill would leave over."""
    words = ("roslaunch", "-p", a_port(), *arguments)
    launched = begin(*words, env=environment, cwd=environment["PWD"], stderr=subprocess.STDOUT)
    said, _ = launched.communicate(timeout=300)
    assert launched.returncode == 0, said
    return str(said)


SHOW = """
import sys, roslaunch
for name in sys.argv[2:]:
    for option in (["--nodes"], ["--dump-params"], ["--args", "/musselbed"]):
        roslaunch.main(["roslaunch", *option, "musselbed", f"{name}.launch", *sys.argv[1].split()])
        print("---")
"""


def shown_by_roslaunch(environment: dict[str, str], options: str) -> dict[str, list[str]]:
    """The nodes, the parameters and our node's command, as roslaunch tells them of each launch file."""
    command = ("/usr/bin/python3", "-c", SHOW, options, *SHIPPED)
    told = done(*command, env=environment, cwd=environment["PWD"]).stdout.split("---\n")
    return {name: told[3 * n : 3 * n + 3] for n, name in enumerate(SHIPPED)}


def test_what_the_launch_files_start(environment: dict[str, str]) -> None:
    for name, (nodes, parameters, told) in shown_by_roslaunch(environment, "").items():
        assert set(nodes.split()) == (WITH_FIVE if name == "bay-120" else WITH_THE_SIMULATED_APAD)
        assert yaml.safe_load(parameters) == {"/use_sim_time": True}
        command = told.split()
        flown = LAUNCH / "scenarios" / f"{'pool-12' if name == 'demo' else name}.yaml"
        assert str(flown) in command
        scenario = load(flown)
        for option, value in {
            "--theta": scenario.theta,
            "--agents": scenario.fleet.count,
            "--strategy": scenario.mission.collection,
        }.items():
            assert command[command.index(option) + 1] == str(value), f"{name}: another scenario than the YAML"


def test_with_an_aPad_of_somebody_elses_time_is_left_alone(environment: dict[str, str]) -> None:
    shown = shown_by_roslaunch(environment, "simulate_apad:=false")
    for nodes, parameters, command in shown.values():
        assert set(nodes.split()) == FLEET_ONLY
        assert "use_sim_time" not in parameters
        assert "--apad ros --time wall" in command and "speed" not in command


def test_five_aPads_on_roslaunchs_master(tmp_path: Path, environment: dict[str, str], begin: Begin) -> None:
    # Two aMussels beside each aPad, one that wants charging and one that does not.
    rows = [f"{n},30,{40 * ((n - 1) // 2) + 20 + n % 2},{0.75 if n % 2 else 0.95}" for n in range(1, 11)]
    (tmp_path / "ten.csv").write_text("\n".join(["id,north,east,battery", *rows]) + "\n")
    fleet = {"start": str(tmp_path / "ten.csv"), "count": 10}
    bay = LAUNCH / "scenarios" / "bay-120.yaml"
    path = write_scenario(tmp_path / "five.yaml", bay, duration_s=30, fleet=fleet, mission={"batch": 1})
    arguments = (f"scenario:={path}", "speed:=4", "agents:=10", "theta:=300", "options:=--seed 3")
    told = roslaunch(begin, environment, "musselbed", "bay-120.launch", *arguments)
    (summary_file,) = [*tmp_path.glob("runs/five-*/summary.json"), None][:1]
    assert summary_file is not None, told
    summary = json.loads(summary_file.read_text())
    assert (summary["agents"], summary["seed"], len(summary["apads"])) == (10, 3, 5), told
    assert summary["counted_s"] == pytest.approx(10 * 30, abs=10) and "process has finished cleanly" in told
    # Each flew an aPad of its own: all took the first aMussel, which lies 1 m from where that aPad starts.
    for name, own in summary["apads"].items():
        assert own["ended_by"] == "mission time", name
        assert own["planned_m"] == pytest.approx(1.0, abs=0.05), name


def test_a_second_clock_is_refused(tmp_path: Path, master: Master, begin: Begin) -> None:
    environment = loopback_environment(tmp_path / "ros", master.uri)
    first = (
        "import rospy, sys; from rosgraph_msgs.msg import Clock\n"
        "rospy.init_node('theirs', disable_signals=True); rospy.Publisher('/clock', Clock, queue_size=1)\n"
        "print('ready', flush=True); sys.stdin.read()"
    )
    theirs = begin(
        sys.executable, "-c", first, env=environment, stdin=subprocess.PIPE, ends_by=signal.SIGTERM
    )
    assert line_of(theirs) == "ready"
    second = done(sys.executable, "-m", "apad_bridge.ros.system.clock_node", env=environment, code=3)
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
    tmp_path: Path, environment: dict[str, str], begin: Begin
) -> None:
    (tmp_path / "told.py").write_text(TOLD)
    (tmp_path / "told.launch").write_text(LAUNCHED.format(folder=tmp_path))
    said = roslaunch(begin, environment, tmp_path / "told.launch")
    words = ["run", "--seed", "3", "--remap", "/apad1/position:=/boat/position"]
    assert f"told {[*words, '--manual', '--open-modem', '3', '--open-modem', '7', '--theta', '60']}" in said
    assert "in /basin" in said


def test_a_namespace_by_hand(tmp_path: Path, environment: dict[str, str]) -> None:
    (tmp_path / "told.py").write_text(TOLD)
    told = done(LAUNCH / "ros_node", tmp_path, "told", "run", "__ns:=lab/basin", "a:=b", env=environment)
    assert told.stdout == "told ['run', '--remap', 'a:=b']\nin lab/basin\n"
