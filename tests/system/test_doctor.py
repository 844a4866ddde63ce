"""`musselbed doctor` as a user runs it: without a master, and on a real one with the simulated aPad."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from scenario_files import POOL_FILE

from apad_bridge.commands.fly.run_checks import tell_docks_in_use
from apad_bridge.doctor import network
from apad_bridge.ros.system.master import Master, loopback_environment, start_master
from apad_bridge.scenario.loader import load
from apad_bridge.scenario.run_options import APadKind, BenchPart, OnDeath, RunOptions, TimeSource

pytestmark = pytest.mark.system
ROOT = Path(__file__).parents[2]

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
    running = start_master(tmp_path / "ros", timeout_s=120, orphan_s=0)
    yield running
    running.stop()


def run_doctor(environment: dict[str, str], *arguments: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "apad_bridge.commands.main", "doctor", *arguments]
    return subprocess.run(command, env=environment, cwd=ROOT, capture_output=True, text=True, timeout=180)


def checks(environment: dict[str, str], *arguments: str) -> dict[str, dict[str, Any]]:
    done = run_doctor(environment, "--json", *arguments)
    assert done.stderr == ""
    findings = json.loads(done.stdout)
    failed = {finding["check"] for finding in findings if finding["status"] == "FAIL"}
    assert done.returncode == (0 if not failed else 2 if failed == {"scenario"} else 3)
    assert all(set(finding) == {"check", "status", "found", "mend"} for finding in findings)
    return {finding["check"]: finding for finding in findings}


def test_without_a_master_a_sound_machine_is_sound(tmp_path: Path) -> None:
    done = run_doctor(loopback_environment(tmp_path), str(POOL_FILE), "--all")
    assert done.returncode == 0, done.stdout + done.stderr
    *lines, total = done.stdout.splitlines()
    assert all(line.startswith(("OK ", "WARN ")) and ": " in line for line in lines)
    fine = sum(line.startswith("OK ") for line in lines)
    assert total == f"{fine} of {len(lines)} checks are OK" and fine > 8
    *short, its_total = run_doctor(loopback_environment(tmp_path), str(POOL_FILE)).stdout.splitlines()
    assert [line.split()[1] for line in short] == [line.split()[1] for line in lines if line[:2] != "OK"]
    assert its_total == f"{total}; --all prints them"
    (master_line,) = [line for line in lines if line.split()[1] == "master:"]
    assert master_line.startswith("OK") and "starts its own" in master_line
    assert not any("call back" in line for line in lines)


def test_a_scenario_that_cannot_be_read_is_the_user_s_mistake_as_it_is_elsewhere(tmp_path: Path) -> None:
    done = run_doctor(loopback_environment(tmp_path), str(tmp_path / "none.yaml"))
    assert done.returncode == 2, done.stdout
    assert [it.split()[1] for it in done.stdout.splitlines() if it.startswith("FAIL")] == ["scenario:"]


def test_a_master_elsewhere_that_does_not_answer_is_a_failure(tmp_path: Path) -> None:
    done = run_doctor(loopback_environment(tmp_path, "http://apad1.invalid:11311"), str(POOL_FILE))
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
    command = [sys.executable, "-m", "apad_bridge.ros.simulated_node.apad_node", "--scenario", str(POOL_FILE)]
    command += ["--generation", generation]
    with subprocess.Popen(command, env=environment, cwd=ROOT, stdout=subprocess.PIPE, text=True) as node:
        try:
            assert node.stdout is not None and node.stdout.readline() == "ready\n"
            found = checks(environment, str(POOL_FILE))
        finally:
            node.terminate()
            node.wait(180)
    for name in ("master", "own address", "call back", "nodes", "aMussel ids", "/apad1"):
        assert found[name]["status"] == "OK", found[name]
    assert md5 in found["/apad1"]["found"]
    beside = found.get("/apad1 beside", {"status": None, "found": ""})
    assert beside["status"] == ("OK" if generation == "b" else None)
    for part in ("commander/go2point ", "commander/docking ", "go2point/result ", "go2point/feedback "):
        assert (part in beside["found"]) is (generation == "b")
    # Nobody publishes /clock here, which the aPad's node follows: both are said.
    assert found["clock"]["status"] == "FAIL"
    assert found["/apad1 clock"]["status"] == "CANNOT TELL"


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
        found = checks(environment, str(POOL_FILE))
    finally:
        fleet.communicate(timeout=180)
    assert found["aMussel ids"]["status"] == "FAIL"
    assert "/other_fleet" in found["aMussel ids"]["found"]


HALF_A_SERVER = """
import sys, rospy
from apad_bridge.ros.types.messages import use_generated_messages
use_generated_messages()
from actionlib_msgs.msg import GoalStatusArray
from apad.msg import aPadActionFeedback, aPadActionGoal, aPadActionResult
from std_msgs.msg import Float64
rospy.init_node("half_a_server", disable_signals=True)
kinds = {"status": GoalStatusArray, "feedback": aPadActionFeedback, "result": aPadActionResult}
topics = [rospy.Publisher(f"/apad1/action_server/{it}", kind, queue_size=1, latch=True) for it, kind in kinds.items()]
topics[0].publish(GoalStatusArray())
battery = rospy.Publisher("/apad1/battery_level", Float64, queue_size=1, latch=True)
if "takes goals" in sys.argv:
    battery.publish(0.0)
    rospy.Subscriber("/apad1/action_server/goal", aPadActionGoal, print)
    rospy.Subscriber("/apad1/action_server/cancel", rospy.AnyMsg, print)
print("ready", flush=True)
sys.stdin.read()
rospy.signal_shutdown("the test is over")
"""

CLOCK = """
import select, sys, time, rospy
from rosgraph_msgs.msg import Clock
rospy.init_node("clock", disable_signals=True)
clock = rospy.Publisher("/clock", Clock, queue_size=1)
print("ready", flush=True)
while not select.select([sys.stdin], [], [], 0.05)[0]:  # until the test closes it
    clock.publish(Clock(rospy.Time.from_sec(time.time())))
"""

ORDER = """
import sys, threading, time, rospy, yaml
from actionlib import SimpleActionClient
from apad_bridge.ros.types.messages import use_generated_messages
use_generated_messages()
from apad.msg import aPadAction, aPadActionGoal
from genpy.message import fill_message_args
from misc_msgs.srv import GetDockingInfo
rospy.init_node("somebody", disable_signals=True)
server = SimpleActionClient(sys.argv[1].removesuffix("/goal"), aPadAction)
server.wait_for_server()
docks = rospy.ServiceProxy("/apad1/check_docking_availability", GetDockingInfo)
for text in sys.argv[2:]:
    before = docks().slots
    goal = aPadActionGoal()
    fill_message_args(goal, [yaml.safe_load(text)])
    server.send_goal(goal.goal)
    until_s = time.monotonic() + 60
    while docks().slots == before:
        assert time.monotonic() < until_s, "the docks hold what they held"
        threading.Event().wait(0.05)  # the service announces nothing
rospy.signal_shutdown("done")
"""


@contextmanager
def running(environment: dict[str, str], *arguments: str) -> Iterator[None]:
    """A process that says `ready`, and ends when its stdin does or it is told to."""
    with subprocess.Popen(
        [sys.executable, *arguments],
        env=environment,
        cwd=ROOT,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    ) as process:
        try:
            assert process.stdout is not None and process.stdout.readline() == "ready\n"
            yield
        finally:
            process.terminate()
            process.communicate(timeout=180)


def order(environment: dict[str, str], topic: str, *goals: str) -> None:
    subprocess.run(
        [sys.executable, "-c", ORDER, topic, *goals], env=environment, cwd=ROOT, timeout=180, check=True
    )


def test_docks_in_use_are_told_with_commands_that_empty_them(
    tmp_path: Path, master: Master, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    environment = loopback_environment(tmp_path, master.uri)
    monkeypatch.setenv("ROS_MASTER_URI", master.uri)
    options = RunOptions(BenchPart.WHOLE, APadKind.ROS, TimeSource.WALL, 1.0, OnDeath.WAIT)
    scenario = load(POOL_FILE)
    node = [
        "-m",
        "apad_bridge.ros.simulated_node.apad_node",
        "--scenario",
        str(POOL_FILE),
        "--generation",
        "a",
    ]
    with running(environment, "-c", CLOCK), running(environment, *node):
        assert checks(environment, str(POOL_FILE))["/apad1 docks"]["status"] == "OK"
        tell_docks_in_use(options, scenario)
        assert capsys.readouterr().err == ""
        perches = [f"{{goal: {{id: 1, object: amussel{agent_id}}}}}" for agent_id in (3, 99)]
        order(environment, "/apad1/action_server/goal", *perches)
        found = checks(environment, str(POOL_FILE))
        tell_docks_in_use(options, scenario)
        docks = found["/apad1 docks"]
        assert docks["status"] == "WARN" and "apad.docks: 2 in the scenario" in docks["mend"]
        ours, others = docks["found"].split("; ")
        assert ours.startswith("hold amussel3: ") and others.startswith("amussel99, which a run does not see")
        assert (
            capsys.readouterr().err
            == f"musselbed: warning: /apad1 docks: {docks['found']}: {docks['mend']}\n"
        )
        commands = re.findall(r"rostopic pub -1 (\S+) apad/aPadActionGoal '([^']*)'", docks["mend"])
        assert len(commands) == 2
        for topic, goal in commands:
            order(environment, topic, goal)
        assert checks(environment, str(POOL_FILE))["/apad1 docks"]["status"] == "OK"
    for name in ("/apad1 action server", "/apad1 battery"):
        assert found[name]["status"] == "OK", found[name]


def test_a_dead_action_server_and_a_silent_battery(tmp_path: Path, master: Master) -> None:
    environment = loopback_environment(tmp_path, master.uri)
    with running(environment, "-c", HALF_A_SERVER):
        found = checks(environment)
        assert "aPad" not in found
        server = found["/apad1 action server"]
        assert server["status"] == "FAIL" and "subscribes to goal" in server["found"]
    with running(environment, "-c", HALF_A_SERVER, "takes goals"):
        found = checks(environment)
        server, battery = found["/apad1 action server"], found["/apad1 battery"]
        assert server["status"] == "FAIL" and "/apad1/action_server/status is silent" in server["found"]
        assert battery["status"] == "WARN" and "says 0 %" in battery["found"]
