"""The launch files: what they would start, and what a node is told."""

from __future__ import annotations

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
from programs import ROOT, Begin, done, ended_well, line_of

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
        flown = LAUNCH / "scenarios" / f"{'pool-12' if name == 'demo' else name}.yaml"
        scenario = load(flown)
        # No option makes it another scenario than the YAML.
        for words in (
            f"{flown} ",
            f"--theta {scenario.theta} ",
            f"--agents {scenario.fleet.count} ",
            f"--strategy {scenario.mission.collection} ",
        ):
            assert words in f"{told} ".replace("\n", " "), name


def test_with_an_aPad_of_somebody_elses_time_is_left_alone(environment: dict[str, str]) -> None:
    for nodes, parameters, command in shown_by_roslaunch(environment, "simulate_apad:=false").values():
        assert set(nodes.split()) == FLEET_ONLY and "use_sim_time" not in parameters
        assert "--apad ros --time wall" in command and "speed" not in command


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


def test_what_a_launch_file_or_a_hand_gives_a_node_becomes_options(
    tmp_path: Path, environment: dict[str, str], begin: Begin
) -> None:
    """Remaps, private parameters and the namespace."""
    (tmp_path / "told.py").write_text(TOLD)
    (tmp_path / "told.launch").write_text(LAUNCHED.format(folder=tmp_path))
    words = ("roslaunch", "-p", a_port(), tmp_path / "told.launch")
    said, _ = ended_well(begin(*words, env=environment, cwd=tmp_path, stderr=subprocess.STDOUT))
    options = ["run", "--seed", "3", "--remap", "/apad1/position:=/boat/position"]
    assert f"told {[*options, '--manual', '--open-modem', '3', '--open-modem', '7', '--theta', '60']}" in said
    assert "in /basin" in said
    told = done(LAUNCH / "ros_node", tmp_path, "told", "run", "__ns:=lab/basin", "a:=b", env=environment)
    assert told.stdout == "told ['run', '--remap', 'a:=b']\nin lab/basin\n"
