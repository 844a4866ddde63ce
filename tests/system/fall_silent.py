"""Simulates a mission that sends the aPad away and falls silent, beside the vehicle's watchdog.

Use: fall_silent.py WATCHDOG a|b, on the master at ROS_MASTER_URI, where the aPad's node runs and nobody else publishes
/clock.
Prints the watchdog's output, the aPad's status and its drift since, as JSON.
"""

from __future__ import annotations

import json
import os
import queue
import subprocess
import sys
import threading
import time
from typing import Any

import rospy
from actionlib import GoalStatus, SimpleActionClient
from geometry_msgs.msg import Point, Pose
from rosgraph_msgs.msg import Clock
from std_msgs.msg import Bool, Float32, Int32, String

from apad_bridge.ros.system.ros_time import to_ros
from apad_bridge.ros.types.messages import generated_folder, use_generated_messages

use_generated_messages()

from apad.msg import aPadAction, aPadGoal  # noqa: E402
from auv_msgs.msg import NavSts  # noqa: E402
from misc_msgs.srv import Go2pointPrimitiveService  # noqa: E402

PATIENCE_S = 180.0
DRIFT_S = 30
STEADY_MS = 15_000


class Mission:
    """Publishes mission time from a thread, ten times as fast as the wall clock, and keeps the aPad's status and place."""

    def __init__(self) -> None:
        self.now_ms = 1_000
        self.heart_beats = True
        self.status = -1
        self.place_m: tuple[float, float] | None = None
        self._clock = rospy.Publisher("/clock", Clock, queue_size=1, latch=True)
        self._heart = rospy.Publisher("/musselbed/heartbeat", Float32, queue_size=1)
        self.watchdog_says = ""
        self.client: Any = None
        """Kept as long as its goal is watched."""
        rospy.Subscriber("/apad1/watchdog", String, self._take_word)
        rospy.Subscriber("/apad1/goto_status", Int32, self._take_status)
        rospy.Subscriber("/apad1/stateRef", NavSts, self._take_place)
        threading.Thread(target=self._run, daemon=True).start()

    def _run(self) -> None:
        pause = threading.Event()
        while not pause.wait(0.01):
            self.now_ms += 100
            self._clock.publish(Clock(to_ros(self.now_ms)))
            if self.heart_beats:
                self._heart.publish(Float32(0.1))

    def _take_word(self, message: Any) -> None:
        self.watchdog_says = message.data

    def _take_status(self, message: Any) -> None:
        self.status = message.data

    def _take_place(self, message: Any) -> None:
        self.place_m = (message.position.north, message.position.east)

    def wait_until(self, condition: Any, failure: str) -> None:
        until_s, pause = time.monotonic() + PATIENCE_S, threading.Event()
        while not condition():
            assert time.monotonic() < until_s, failure
            pause.wait(0.02)

    def let_pass(self, ms: int) -> tuple[float, float]:
        """Returns the aPad's place after `ms`."""
        then_ms = self.now_ms + ms
        self.wait_until(lambda: self.now_ms >= then_ms, "/clock stands still")
        assert self.place_m is not None
        return self.place_m


class Watchdog:
    def __init__(self, path: str) -> None:
        # As on a vehicle: the machine's ROS and a workspace's messages, without our package.
        self.process = subprocess.Popen(
            ["/usr/bin/python3", path, "--silence-s", "1"],
            env=rospy_environment(),
            stdout=subprocess.PIPE,
            text=True,
        )
        self._lines: queue.Queue[str] = queue.Queue()
        threading.Thread(target=self._read, daemon=True).start()

    def _read(self) -> None:
        assert self.process.stdout is not None
        for line in self.process.stdout:
            self._lines.put(line.strip())

    def until(self, word: str) -> list[str]:
        """Its output up to and with a line that begins with `word`."""
        lines: list[str] = []
        while not lines or not lines[-1].startswith(word):
            lines.append(self._lines.get(timeout=PATIENCE_S))
        return lines


def rospy_environment() -> dict[str, str]:
    return os.environ | {"PYTHONPATH": str(generated_folder()), "PYTHONUNBUFFERED": "1"}


def by_primitive(mission: Mission) -> None:
    rospy.wait_for_service("/apad1/commander/primitive/go2point", PATIENCE_S)
    go = rospy.ServiceProxy("/apad1/commander/primitive/go2point", Go2pointPrimitiveService)
    assert go(point=Point(10_000, 0, 0), speed=0.5, victory_radius=1.0).status


def by_goal(mission: Mission) -> None:
    """The states of a goal have the numbers of `goto_status` while it runs (1) and when another takes its place (2).

    It is asked whether it runs: actionlib loses the callback of a server that answers before `send_goal` has returned.
    """
    client = SimpleActionClient("/apad1/action_server", aPadAction)
    assert client.wait_for_server(rospy.Duration(PATIENCE_S))
    client.send_goal(
        aPadGoal(id=0, pose=Pose(position=Point(10_000, 0, 0))),
        done_cb=lambda state, _: setattr(mission, "status", state),
    )
    mission.wait_until(lambda: client.get_state() == GoalStatus.ACTIVE, "the goal does not run")
    mission.status = GoalStatus.ACTIVE
    mission.client = client


SEND_AWAY = {"a": by_goal, "b": by_primitive}


def main() -> None:
    rospy.init_node("mission", disable_signals=True)
    pilot = rospy.Publisher("/apad1/manual", Bool, queue_size=1, latch=True)
    mission = Mission()
    watchdog = Watchdog(sys.argv[1])
    result: dict[str, Any] = {}
    try:
        result["hears"] = watchdog.until("WATCHING")
        mission.wait_until(lambda: mission.place_m is not None, "no stateRef")
        SEND_AWAY[sys.argv[2]](mission)
        mission.wait_until(lambda: mission.status == 1, "no go-to under way")
        mission.heart_beats = False
        result["falls_silent"] = watchdog.until("HELD")
        mission.wait_until(lambda: mission.watchdog_says == "HELD", "/apad1/watchdog does not say so")
        mission.wait_until(lambda: mission.status != 1, "the go-to goes on")
        result["status"] = mission.status
        held_m = mission.let_pass(STEADY_MS)
        there_m = mission.let_pass(DRIFT_S * 1000)
        result["drifted_m"] = [there_m[it] - held_m[it] for it in (0, 1)]
        mission.heart_beats = True
        result["hears_again"] = watchdog.until("WATCHING")
        pilot.publish(Bool(True))
        ears = 1 + (sys.argv[2] == "b")  # the watchdog, and the vehicle of generation B
        mission.wait_until(lambda: pilot.get_num_connections() >= ears, "nobody hears the pilot")
        mission.heart_beats = False
        result["piloted"] = watchdog.until("PILOTED")
        assert watchdog.process.poll() is None
    finally:
        watchdog.process.terminate()
        watchdog.process.wait(PATIENCE_S)
    print(json.dumps(result))


if __name__ == "__main__":
    main()
