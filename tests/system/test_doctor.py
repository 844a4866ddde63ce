"""`musselbed doctor` as a user runs it: without a master, and on a real one with the simulated aPad."""

from __future__ import annotations

import json
import re
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from programs import Begin, done, line_of, musselbed, wait_until
from scenario_files import POOL_FILE

from apad_bridge.commands.fly.run_checks import show_docks_in_use
from apad_bridge.doctor import network
from apad_bridge.ros.system.master import Master, loopback_environment
from apad_bridge.scenario.loader import load
from apad_bridge.scenario.run_options import APadKind, BenchPart, OnDeath, RunOptions, TimeSource

pytestmark = pytest.mark.system
NODE = ("-m", "apad_bridge.ros.simulated_node.apad_node", "--scenario", POOL_FILE, "--generation")


@pytest.fixture
def on_master(tmp_path: Path, master: Master) -> dict[str, str]:
    return loopback_environment(tmp_path, master.uri)


@pytest.fixture
def running(begin: Begin, on_master: dict[str, str]) -> Begin:
    """Starts a program of Python that says `ready`; the test may end it."""

    def start(*arguments: object) -> subprocess.Popen[str]:
        words = (sys.executable, *arguments)
        process = begin(*words, env=on_master, stdin=subprocess.PIPE, ends_by=signal.SIGTERM)
        assert line_of(process) == "ready"
        return process

    return start


def checks(environment: dict[str, str], *arguments: object) -> dict[str, dict[str, Any]]:
    ended = musselbed("doctor", "--json", *arguments, env=environment, code=None)
    assert ended.stderr == ""
    findings = json.loads(ended.stdout)
    failed = {finding["check"] for finding in findings if finding["status"] == "FAIL"}
    assert ended.returncode == (0 if not failed else 2 if failed == {"scenario"} else 3)
    assert all(set(finding) == {"check", "status", "found", "mend"} for finding in findings)
    return {finding["check"]: finding for finding in findings}


def test_without_a_master_a_sound_machine_is_sound(tmp_path: Path) -> None:
    ended = musselbed("doctor", POOL_FILE, "--all", env=loopback_environment(tmp_path))
    *lines, total = ended.stdout.splitlines()
    assert all(line.startswith(("OK ", "WARN ")) and ": " in line for line in lines)
    fine = sum(line.startswith("OK ") for line in lines)
    assert total == f"{fine} of {len(lines)} checks are OK" and fine > 8
    *short, its_total = musselbed("doctor", POOL_FILE, env=loopback_environment(tmp_path)).stdout.splitlines()
    assert [line.split()[1] for line in short] == [line.split()[1] for line in lines if line[:2] != "OK"]
    assert its_total == f"{total}; --all prints them"
    (master_line,) = [line for line in lines if line.split()[1] == "master:"]
    assert master_line.startswith("OK") and "starts its own" in master_line
    assert not any("call back" in line for line in lines)


@pytest.mark.parametrize(
    ("master_uri", "scenario", "check", "status", "words"),
    [
        ("", "none.yaml", "scenario", "FAIL", ""),
        ("http://apad1.invalid:11311", POOL_FILE, "master", "FAIL", "/etc/hosts"),
        ("http://127.0.0.1:9/", POOL_FILE, "master", "WARN", "http://127.0.0.1:9"),
    ],
    ids=["a scenario that cannot be read", "a master elsewhere that does not answer", "one that is gone"],
)
def test_one_finding(
    master_uri: str, scenario: object, check: str, status: str, words: str, tmp_path: Path
) -> None:
    environment = loopback_environment(tmp_path, *filter(None, [master_uri]))
    found = checks(environment, scenario)
    assert found[check]["status"] == status and words in found[check]["found"] + found[check]["mend"]
    assert {it for it in found if found[it]["status"] == "FAIL"} == ({check} if status == "FAIL" else set())


@pytest.mark.parametrize(
    ("generation", "md5"),
    [
        ("a", "position d1c2e3fd518b63978e72fa7409f4ba71"),
        ("b", "commander/primitive/docking 2f37c62380c61eaf8bf8692a9128c0fd"),
    ],
)
def test_the_simulated_apad_on_a_real_master(
    on_master: dict[str, str], master: Master, running: Begin, generation: str, md5: str
) -> None:
    assert checks(on_master)["call back"]["status"] == "OK"
    # The doctor leaves nothing on the master.
    assert checks(on_master)["nodes"]["found"] == "none on the graph"
    network.call(master.uri, "setParam", "/use_sim_time", True)
    running(*NODE, generation)
    found = checks(on_master, POOL_FILE)
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


def order(environment: dict[str, str], topic: str, *goals: str) -> None:
    done(sys.executable, "-c", ORDER, topic, *goals, env=environment)


def test_docks_in_use_are_told_with_commands_that_empty_them(
    on_master: dict[str, str],
    master: Master,
    running: Begin,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setenv("ROS_MASTER_URI", master.uri)
    options = RunOptions(BenchPart.WHOLE, APadKind.ROS, TimeSource.WALL, 1.0, OnDeath.WAIT)
    running("-c", CLOCK)
    running(*NODE, "a")

    def is_silent() -> bool:
        """Before the node has heard /clock, it reports no docks."""
        show_docks_in_use(options, load(POOL_FILE))
        return capsys.readouterr().err == ""

    wait_until(is_silent)
    perches = [f"{{goal: {{id: 1, object: amussel{agent_id}}}}}" for agent_id in (3, 99)]
    order(on_master, "/apad1/action_server/goal", *perches)
    found = checks(on_master, POOL_FILE)
    show_docks_in_use(options, load(POOL_FILE))
    docks = found["/apad1 docks"]
    assert docks["status"] == "WARN" and "apad.docks: 2 in the scenario" in docks["mend"]
    ours, others = docks["found"].split("; ")
    assert ours.startswith("hold amussel3: ") and others.startswith("amussel99, which a run does not see")
    told = f"musselbed: warning: /apad1 docks: {docks['found']}: {docks['mend']}\n"
    assert capsys.readouterr().err == told
    commands = re.findall(r"rostopic pub -1 (\S+) apad/aPadActionGoal '([^']*)'", docks["mend"])
    assert len(commands) == 2
    for topic, goal in commands:
        order(on_master, topic, goal)
    assert checks(on_master, POOL_FILE)["/apad1 docks"]["status"] == "OK"
    for name in ("/apad1 action server", "/apad1 battery"):
        assert found[name]["status"] == "OK", found[name]


@pytest.mark.parametrize(
    ("takes_goals", "said"),
    [((), "subscribes to goal"), (("takes goals",), "/apad1/action_server/status is silent")],
)
def test_a_dead_action_server_and_a_silent_battery(
    takes_goals: tuple[str, ...], said: str, on_master: dict[str, str], running: Begin
) -> None:
    running("-c", HALF_A_SERVER, *takes_goals)
    found = checks(on_master)
    server = found["/apad1 action server"]
    assert server["status"] == "FAIL" and said in server["found"] and "aPad" not in found
    if takes_goals:
        battery = found["/apad1 battery"]
        assert battery["status"] == "WARN" and "says 0 %" in battery["found"]
