"""Simulates a mission that sends the aPad away and falls silent, beside the vehicle's watchdog.

Use: fall_silent.py WATCHDOG a|b PYTHON, on the master at ROS_MASTER_URI, where the aPad's node runs and nobody else
publishes /clock. PYTHON runs the watchdog.
The mission falls silent, comes back, and falls silent under a pilot. Then the master ends, which is asked for by `end the
master` and confirmed by a line on the standard input; then the mission falls silent, first with a good position and then
with a bad one.
Prints the watchdog's output, the aPad's status and its ways, as JSON.
"""

from __future__ import annotations

import json
import os
import queue
import signal
import subprocess
import sys
import threading
from typing import Any

import rospy
from actionlib import GoalStatus, SimpleActionClient
from geometry_msgs.msg import Point, Pose
from programs import wait_until
from rosgraph_msgs.msg import Clock
from std_msgs.msg import Bool, Float32, Int32, String

from apad_bridge.ros.system.ros_time import to_ros
from apad_bridge.ros.types.messages import generated_folder, use_generated_messages

use_generated_messages()

from apad.msg import aPadAction, aPadGoal  # noqa: E402
from auv_msgs.msg import NavSts  # noqa: E402
from misc_msgs.srv import Go2pointPrimitiveService  # noqa: E402

PATIENCE_S = 180.0
DRIFT_S = 15
SOON = 15
"""The speed of what passes while no heart beats: a watchdog that is late is silent then, too."""
STEADY_MS = 15_000


class Mission:
    """Publishes mission time from a thread, `speed` times the wall clock, and keeps the aPad's status and place.

    The watchdog gets the positions through it.
    """

    def __init__(self, speed: int) -> None:
        self.now_ms = 1_000
        self.speed = speed
        self.north_m: float | None = None
        """What the watchdog gets instead of the position north."""
        self.heart_beats = True
        self.status = -1
        self.place_m: tuple[float, float] | None = None
        self._clock = rospy.Publisher("/clock", Clock, queue_size=1, latch=True)
        self._heart = rospy.Publisher("/musselbed/heartbeat", Float32, queue_size=1)
        self.watchdog_says = ""
        self.client: Any = None
        """Kept as long as its goal is watched."""
        rospy.Subscriber("/apad1/watchdog", String, self._take, "watchdog_says")
        rospy.Subscriber("/apad1/goto_status", Int32, self._take, "status")
        rospy.Subscriber("/apad1/stateRef", NavSts, self._take_place)
        self._relayed = rospy.Publisher("/relayed/position", NavSts, queue_size=10)
        rospy.Subscriber("/apad1/position", NavSts, self._relay)
        threading.Thread(target=self._run, daemon=True).start()

    def _run(self) -> None:
        pause = threading.Event()
        while not pause.wait(0.1 / self.speed):
            self.now_ms += 100
            self._clock.publish(Clock(to_ros(self.now_ms)))
            if self.heart_beats:
                self._heart.publish(Float32(0.1))

    def _take(self, message: Any, name: str) -> None:
        setattr(self, name, message.data)

    def _take_place(self, message: Any) -> None:
        self.place_m = (message.position.north, message.position.east)

    def _relay(self, message: Any) -> None:
        if self.north_m is not None:
            message.position.north = self.north_m
        self._relayed.publish(message)

    def let_pass(self, ms: int) -> tuple[float, float]:
        """Returns the aPad's place after `ms`."""
        then_ms, before = self.now_ms + ms, self.speed
        self.speed = before if self.heart_beats else SOON
        wait_until(lambda: self.now_ms >= then_ms, why="/clock stands still")
        self.speed = before
        assert self.place_m is not None
        return self.place_m


class Watchdog:
    def __init__(self, path: str, python: str) -> None:
        # As on a vehicle: the machine's ROS and a workspace's messages, without our package.
        self.process = subprocess.Popen(
            [python, path, "--silence-s", "1", "/apad1/position:=/relayed/position"],
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
    if mission.client is None:
        rospy.wait_for_service("/apad1/commander/primitive/go2point", PATIENCE_S)
        mission.client = rospy.ServiceProxy(
            "/apad1/commander/primitive/go2point", Go2pointPrimitiveService, persistent=True
        )
    assert mission.client(point=Point(10_000, 0, 0), speed=0.5, victory_radius=1.0).status


def by_goal(mission: Mission) -> None:
    """The states of a goal have the numbers of `goto_status` while it runs (1) and when another takes its place (2).

    It is asked whether it runs: actionlib loses the callback of a server that answers before `send_goal` has returned.
    """
    client = mission.client or SimpleActionClient("/apad1/action_server", aPadAction)
    assert client.wait_for_server(rospy.Duration(PATIENCE_S))
    client.send_goal(
        aPadGoal(id=0, pose=Pose(position=Point(10_000, 0, 0))),
        done_cb=lambda state, _: setattr(mission, "status", state),
    )
    wait_until(lambda: client.get_state() == GoalStatus.ACTIVE, why="the goal does not run")
    mission.status = GoalStatus.ACTIVE
    mission.client = client


SEND_AWAY = {"a": by_goal, "b": by_primitive}


def sent_away(mission: Mission, generation: str) -> None:
    wait_until(lambda: mission.place_m is not None, why="no stateRef")
    SEND_AWAY[generation](mission)
    wait_until(lambda: mission.status == 1, why="no go-to under way")
    north_m = mission.let_pass(5_000)[0]
    assert mission.let_pass(5_000)[0] > north_m + 1


def way_m(mission: Mission, ms: int) -> list[float]:
    """Metres north and east in `ms`."""
    before, after = mission.let_pass(0), mission.let_pass(ms)
    return [after[it] - before[it] for it in (0, 1)]


def held(mission: Mission, watchdog: Watchdog) -> dict[str, Any]:
    """Falls silent, and waits until the aPad is held."""
    mission.heart_beats = False
    said = watchdog.until("HELD")
    wait_until(lambda: mission.watchdog_says == "HELD", why="/apad1/watchdog does not say so")
    wait_until(lambda: mission.status != 1, why="the go-to goes on")
    mission.let_pass(STEADY_MS)
    return {"falls_silent": said, "status": mission.status, "drifted_m": way_m(mission, DRIFT_S * 1000)}


def play(mission: Mission, watchdog: Watchdog, generation: str) -> dict[str, Any]:
    pilot = rospy.Publisher("/apad1/manual", Bool, queue_size=1, latch=True)
    sent_away(mission, generation)
    result: dict[str, Any] = {"silent": held(mission, watchdog)}
    mission.heart_beats = True
    result["hears_again"] = watchdog.until("WATCHING")
    pilot.publish(Bool(True))
    ears = 1 + (generation == "b")  # the watchdog, and the vehicle of generation B
    wait_until(lambda: pilot.get_num_connections() >= ears, why="nobody hears the pilot")
    mission.heart_beats = False
    result["piloted"] = watchdog.until("PILOTED")
    pilot.publish(Bool(False))
    mission.heart_beats = True
    watchdog.until("WATCHING")

    sent_away(mission, generation)
    watchdog.process.send_signal(signal.SIGHUP)  # its shell was beyond the network
    print("end the master", flush=True)
    assert sys.stdin.readline()
    result["lost"] = held(mission, watchdog)
    mission.heart_beats = True
    watchdog.until("WATCHING")
    sent_away(mission, generation)
    mission.north_m, mission.heart_beats = float("nan"), False
    result["is_blind"] = watchdog.until("OFF")
    mission.let_pass(4 * STEADY_MS)
    result["off_m"] = way_m(mission, DRIFT_S * 1000)
    mission.north_m = None
    mission.let_pass(DRIFT_S * 1000)
    return result | {"stays": mission.watchdog_says}


def main() -> None:
    rospy.init_node("mission", disable_signals=True)
    mission = Mission(speed=5)
    watchdog = Watchdog(sys.argv[1], sys.argv[3])
    try:
        hears = watchdog.until("WATCHING")
        result = play(mission, watchdog, sys.argv[2])
        assert watchdog.process.poll() is None
    finally:
        watchdog.process.terminate()
        watchdog.process.wait(PATIENCE_S)
    print(json.dumps(result | {"hears": hears}))


if __name__ == "__main__":
    main()
