"""Plays a mission that sends the simulated aPad of generation B away and falls silent, beside the vehicle's watchdog.

Use: fall_silent.py WATCHDOG, on the master at ROS_MASTER_URI, where the aPad's node runs and nobody else publishes /clock.
Prints what the watchdog said, what the aPad's status says and how far it has drifted since, as JSON.
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
from geometry_msgs.msg import Point
from rosgraph_msgs.msg import Clock
from std_msgs.msg import Bool, Int32, String

from apad_bridge.ros.system.ros_time import to_ros
from apad_bridge.ros.types.messages import generated_folder, use_generated_messages

use_generated_messages()

from auv_msgs.msg import NavSts  # noqa: E402
from misc_msgs.srv import Go2pointPrimitiveService  # noqa: E402

PATIENCE_S = 40.0
DRIFT_S = 30
STEADY_MS = 15_000


class Sea:
    """Mission time that runs in a thread of its own, ten times as fast as the wall clock; and what is heard meanwhile."""

    def __init__(self) -> None:
        self.now_ms = 1_000
        self.heart_beats = True
        self.status = -1
        self.place_m: tuple[float, float] | None = None
        self._clock = rospy.Publisher("/clock", Clock, queue_size=1, latch=True)
        self._heart = rospy.Publisher("/musselbed/apad", String, queue_size=1)
        rospy.Subscriber("/apad1/goto_status", Int32, self._hear_status)
        rospy.Subscriber("/apad1/stateRef", NavSts, self._hear_place)
        threading.Thread(target=self._run, daemon=True).start()

    def _run(self) -> None:
        pause = threading.Event()
        while not pause.wait(0.01):
            self.now_ms += 100
            self._clock.publish(Clock(to_ros(self.now_ms)))
            if self.heart_beats:
                self._heart.publish(String("tick"))

    def _hear_status(self, message: Any) -> None:
        self.status = message.data

    def _hear_place(self, message: Any) -> None:
        self.place_m = (message.position.north, message.position.east)

    def wait_until(self, is_so: Any, what: str) -> None:
        until_s, pause = time.monotonic() + PATIENCE_S, threading.Event()
        while not is_so():
            assert time.monotonic() < until_s, what
            pause.wait(0.02)

    def let_pass(self, ms: int) -> tuple[float, float]:
        """Where the aPad is then."""
        then_ms = self.now_ms + ms
        self.wait_until(lambda: self.now_ms >= then_ms, "/clock stands still")
        assert self.place_m is not None
        return self.place_m


class Watchdog:
    def __init__(self, path: str) -> None:
        # As on a vehicle: the ROS of the machine and a workspace's messages, and nothing of ours.
        self.process = subprocess.Popen(
            ["/usr/bin/python3", path, "--silence-s", "1"],
            env=rospy_environment(),
            stdout=subprocess.PIPE,
            text=True,
        )
        self._said: queue.Queue[str] = queue.Queue()
        threading.Thread(target=self._read, daemon=True).start()

    def _read(self) -> None:
        assert self.process.stdout is not None
        for line in self.process.stdout:
            self._said.put(line.strip())

    def until(self, word: str) -> list[str]:
        """What it says up to and with a line that begins with `word`."""
        said: list[str] = []
        while not said or not said[-1].startswith(word):
            said.append(self._said.get(timeout=PATIENCE_S))
        return said


def rospy_environment() -> dict[str, str]:
    return os.environ | {"PYTHONPATH": str(generated_folder()), "PYTHONUNBUFFERED": "1"}


def main() -> None:
    rospy.init_node("mission", disable_signals=True)
    pilot = rospy.Publisher("/apad1/manual", Bool, queue_size=1, latch=True)
    sea = Sea()
    watchdog = Watchdog(sys.argv[1])
    told: dict[str, Any] = {}
    try:
        told["hears"] = watchdog.until("WATCHING")
        sea.wait_until(lambda: sea.place_m is not None, "no stateRef")
        rospy.wait_for_service("/apad1/commander/primitive/go2point", PATIENCE_S)
        go = rospy.ServiceProxy("/apad1/commander/primitive/go2point", Go2pointPrimitiveService)
        assert go(point=Point(10_000, 0, 0), speed=0.5, victory_radius=1.0).status
        sea.wait_until(lambda: sea.status == 1, "no go-to under way")
        sea.heart_beats = False
        told["falls_silent"] = watchdog.until("HELD")
        sea.wait_until(lambda: sea.status != 1, "the go-to goes on")
        told["status"] = sea.status
        held_m = sea.let_pass(STEADY_MS)
        there_m = sea.let_pass(DRIFT_S * 1000)
        told["drifted_m"] = [there_m[it] - held_m[it] for it in (0, 1)]
        sea.heart_beats = True
        told["hears_again"] = watchdog.until("WATCHING")
        pilot.publish(Bool(True))
        sea.wait_until(lambda: pilot.get_num_connections() >= 2, "nobody hears the pilot")
        sea.heart_beats = False
        told["piloted"] = watchdog.until("PILOTED")
        assert watchdog.process.poll() is None
    finally:
        watchdog.process.terminate()
        watchdog.process.wait(PATIENCE_S)
    print(json.dumps(told))


if __name__ == "__main__":
    main()
