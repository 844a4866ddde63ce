"""`musselbed doctor` as a user runs it: without a master, and on a real one with the simulated aPad."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from apad_bridge.doctor import network
from apad_bridge.ros.system.master import Master, loopback_environment, start_master

pytestmark = pytest.mark.system
ROOT = Path(__file__).parents[2]
POOL = ROOT / "launch_scripts" / "scenarios" / "pool-12.yaml"

OTHER_FLEET = """
import sys, rospy
from std_msgs.msg import Float64
rospy.init_node("other_fleet", disable_signals=True)
topic = rospy.Publisher("/amussel5/position", Float64, queue_size=1)
print("ready", flush=True)
sys.stdin.read()
rospy.signal_shutdown("the test is over")
"""


@pytest.fixture
def master(tmp_path: Path) -> Iterator[Master]:
    running = start_master(tmp_path / "ros", timeout_s=20, orphan_s=0)
    yield running
    running.stop()


def run_doctor(environment: dict[str, str], *arguments: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "apad_bridge.commands.main", "doctor", *arguments]
    return subprocess.run(command, env=environment, cwd=ROOT, capture_output=True, text=True, timeout=60)


def checks(environment: dict[str, str], *arguments: str) -> dict[str, dict[str, Any]]:
    done = run_doctor(environment, "--json", *arguments)
    assert done.stderr == ""
    findings = json.loads(done.stdout)
    assert (done.returncode == 3) == any(finding["status"] == "FAIL" for finding in findings)
    assert all(set(finding) == {"check", "status", "found", "mend"} for finding in findings)
    return {finding["check"]: finding for finding in findings}


def test_without_a_master_a_sound_machine_is_sound(tmp_path: Path) -> None:
    done = run_doctor(loopback_environment(tmp_path), str(POOL))
    assert done.returncode == 0, done.stdout + done.stderr
    lines = done.stdout.splitlines()
    assert all(line.startswith(("OK ", "WARN ")) and ": " in line for line in lines)
    (master_line,) = [line for line in lines if line.split()[1] == "master:"]
    assert master_line.startswith("WARN") and "brings its own" in master_line
    assert not any("call back" in line for line in lines)


def test_a_master_elsewhere_that_does_not_answer_is_a_failure(tmp_path: Path) -> None:
    done = run_doctor(loopback_environment(tmp_path, "http://apad1.invalid:11311"), str(POOL))
    (master_line,) = [line for line in done.stdout.splitlines() if line.split()[1] == "master:"]
    assert done.returncode == 3, done.stdout
    assert master_line.startswith("FAIL") and "/etc/hosts" in master_line


def test_a_master_that_is_gone_is_no_failure(tmp_path: Path, master: Master) -> None:
    master.stop()
    found = checks(loopback_environment(tmp_path, master.uri))
    assert found["master"]["status"] == "WARN" and master.uri in found["master"]["found"]


def test_a_wrong_scenario_is_a_failure(tmp_path: Path) -> None:
    (tmp_path / "odd.yaml").write_text("name: odd\n")
    found = checks(loopback_environment(tmp_path), str(tmp_path / "odd.yaml"))
    assert found["scenario"]["status"] == "FAIL"


@pytest.mark.parametrize(
    ("generation", "md5"),
    [
        ("a", "position d1c2e3fd518b63978e72fa7409f4ba71"),
        ("b", "commander/primitive/docking 2f37c62380c61eaf8bf8692a9128c0fd"),
    ],
)
def test_the_simulated_apad_on_a_real_master(
    tmp_path: Path, master: Master, generation: str, md5: str
) -> None:
    environment = loopback_environment(tmp_path, master.uri)
    network.call(master.uri, "setParam", "/use_sim_time", True)
    command = [sys.executable, "-m", "apad_bridge.ros.simulated_node.apad_node", "--scenario", str(POOL)]
    command += ["--generation", generation]
    with subprocess.Popen(command, env=environment, cwd=ROOT, stdout=subprocess.PIPE, text=True) as node:
        try:
            assert node.stdout is not None and node.stdout.readline() == "ready\n"
            found = checks(environment, str(POOL))
        finally:
            node.terminate()
            node.wait(20)
    for name in ("master", "own address", "call back", "nodes", "aMussel ids", "/apad1"):
        assert found[name]["status"] == "OK", found[name]
    assert md5 in found["/apad1"]["found"]
    beside = found.get("/apad1 beside", {"status": None, "found": ""})
    assert beside["status"] == ("OK" if generation == "b" else None)
    for part in ("commander/go2point ", "commander/docking ", "go2point/result ", "go2point/feedback "):
        assert (part in beside["found"]) is (generation == "b")
    # Nobody publishes /clock here, which the aPad's node follows: both are said.
    assert found["clock"]["status"] == "FAIL"
    assert found["/apad1 clock"]["status"] == "WARN"


def test_it_leaves_nothing_on_the_master(tmp_path: Path, master: Master) -> None:
    environment = loopback_environment(tmp_path, master.uri)
    assert checks(environment)["call back"]["status"] == "OK"
    assert checks(environment)["nodes"]["found"] == "none on the graph"


def test_a_name_that_the_master_cannot_call(tmp_path: Path, master: Master) -> None:
    environment = loopback_environment(tmp_path, master.uri) | {"ROS_HOSTNAME": "mussel.invalid"}
    found = checks(environment)
    for name in ("own address", "call back"):
        assert found[name]["status"] == "FAIL" and "ROS_IP=127.0.0.1" in found[name]["mend"]


def test_ids_of_another_fleet(tmp_path: Path, master: Master) -> None:
    environment = loopback_environment(tmp_path, master.uri)
    fleet = subprocess.Popen(
        [sys.executable, "-c", OTHER_FLEET],
        env=environment,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    try:
        assert fleet.stdout is not None and fleet.stdout.readline() == "ready\n"
        found = checks(environment, str(POOL))
    finally:
        fleet.communicate(timeout=20)
    assert found["aMussel ids"]["status"] == "FAIL"
    assert "/other_fleet" in found["aMussel ids"]["found"]
