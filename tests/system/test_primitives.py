"""Mission primitives over ROS, by whoever calls: a person's command line, and a program's actions."""

import json
import re
import sys
from pathlib import Path

import pytest
from programs import MUSSELBED, ROOT, Begin, done, ended_well, lines_of, wait_until
from scenario_files import write_scenario

from apad_bridge.ros.system.master import loopback_environment

pytestmark = pytest.mark.system

CLIENT = """
import json, sys, threading, time
from apad_bridge.ros.types.messages import use_generated_messages
use_generated_messages()
import actionlib, rospy
from musselbed_msgs.msg import DockingAction, DockingGoal, GoToAction, GoToActionFeedback, GoToGoal
from musselbed_msgs.srv import Dock, GoToPosition, Undock
from std_srvs.srv import Trigger

agent, north_m, east_m = int(sys.argv[1]), float(sys.argv[2]), float(sys.argv[3])
rospy.init_node("somebody", disable_signals=True)
told = {}
# Not the client's: it receives no feedback after the result, and topics keep no order.
distances_m = []
feedback = rospy.Subscriber(
    "/musselbed/apad1/go_to/feedback", GoToActionFeedback, lambda it: distances_m.append(it.feedback.distance_m)
)
go_to = actionlib.SimpleActionClient("/musselbed/apad1/go_to", GoToAction)
docking = actionlib.SimpleActionClient("/musselbed/apad1/docking", DockingAction)


def wait_until(holds):
    until_s = time.monotonic() + 180
    while not holds():
        assert time.monotonic() < until_s
        threading.Event().wait(0.02)


def asked(name, kind, **request):
    answer = rospy.ServiceProxy(name, kind)(**request)
    return [answer.accepted, answer.message]


def done(client, goal):
    client.send_goal(goal)
    assert client.wait_for_result(rospy.Duration(2000))
    result = client.get_result()
    return [client.get_state(), result.status, result.message]


# By the wall's time: the mission's runs thirty times as fast, and a busy machine starts no faster.
wait_until(lambda: go_to.wait_for_server(rospy.Duration(30)) and docking.wait_for_server(rospy.Duration(30)))
told["too_far"] = asked("/musselbed/apad1/dock", Dock, number=2, id=agent)
told["nowhere"] = asked("/musselbed/apad1/go_to_position", GoToPosition, latitude=91.0, longitude=0.0)
wait_until(lambda: feedback.get_num_connections() > 0)
told["went"] = done(go_to, GoToGoal(north_m=north_m, east_m=east_m, victory_radius_m=0.3))
wait_until(lambda: distances_m and distances_m[-1] < 3)
told["feedback_m"] = [distances_m[0], distances_m[-1]]
told["docked"] = done(docking, DockingGoal(dock=True, number=2, id=agent))
told["let_go"] = done(docking, DockingGoal(dock=False, number=2))
told["empty"] = asked("/musselbed/apad1/undock", Undock, number=2)
cancelled = []
go_to.send_goal(GoToGoal(north_m=north_m + 300), feedback_cb=lambda _: cancelled or cancelled.append(go_to.cancel_goal()))
assert go_to.wait_for_result(rospy.Duration(2000))
told["cancelled"] = [go_to.get_state(), go_to.get_result().status, go_to.get_result().message]
told["ended"] = rospy.ServiceProxy("/musselbed/apad1/abort", Trigger)().success
print(json.dumps(told))
"""
SUCCEEDED, PREEMPTED = 3, 2
"""Of actionlib_msgs/GoalStatus."""


@pytest.fixture
def scenario(tmp_path: Path) -> Path:
    return write_scenario(
        tmp_path / "called.yaml",
        duration_s=36_000,
        theta=600,
        fleet={"count": 3, "start": {"charge": [0.5, 0.75]}, "hosting": "one_process"},
        area={"polygon_m": [[0, 0], [6, 0], [6, 4], [0, 4]]},
        apad={"start_m": [12, 2]},
        mission={"docking": {"dock_s": 3, "undock_s": 1}},
        board={"float_timeout_s": 432000},
    )


def test_an_apad_is_flown_by_calls(scenario: Path, tmp_path: Path, begin: Begin) -> None:
    run = tmp_path / "run"
    options = ("--manual", "--generation", "b", "--speed", 30, "--out", run, "--json")
    flight = begin(*MUSSELBED, "run", scenario, *options)
    wait_until(lambda: lines_of(run, "mission"), flight)
    uri = json.loads((run / "run.json").read_text())["master_uri"]
    environment = loopback_environment(tmp_path / "ros", uri)
    # Debian's own rosservice, in a shell that sourced setup.bash, with every line of the page.
    calls = re.findall(r"^    (rosservice call .*)$", (ROOT / "docs/apads.md").read_text(), re.MULTILINE)
    script = "; ".join([f"source '{ROOT}/launch_scripts/setup.bash'", *calls])
    called = done("bash", "-c", script, env=environment, code=None)
    assert called.stdout.count("accepted: True") == 4, called.stdout + called.stderr
    assert called.stdout.count("success: True") == 2
    assert len(calls) == 9 and "aMussel 7 never reported" in called.stdout
    assert "no mission to which to give the aPad back" in called.stdout
    # A stop by a service is a person's: numbered, taken by the vehicle, and in force until `continue`.
    assert "stop 1: hold, " in called.stdout
    assert [it["order"] for it in lines_of(run, "operator")] == ["stop", "continue"]
    agent = lines_of(run)[0]["agents"][0]
    where = [agent["id"], agent["north_m"], agent["east_m"]]
    told = json.loads(done(sys.executable, "-c", CLIENT, *where, env=environment).stdout.splitlines()[-1])
    for name, words in (("too_far", "go there first"), ("nowhere", "latitude")):
        accepted, message = told.pop(name)
        assert not accepted and words in message
    first_m, last_m = told.pop("feedback_m")
    assert first_m > 3 > last_m
    assert told == {
        **{name: [SUCCEEDED, 3, ""] for name in ("went", "docked", "let_go")},
        "empty": [False, "dock 2 is empty"],
        "cancelled": [PREEMPTED, 2, "cancelled"],
        "ended": True,
    }
    assert json.loads(ended_well(flight)[0])["ended_by"] == "a call: abort by node /somebody"
    docks = [(it["dock"], it["agent"], it["closed"]) for it in lines_of(run, "dock")]
    assert docks == [(1, agent["id"], True), (1, agent["id"], False)]
