"""Starts and ends the process that publishes on ROS 2, in an environment of its own, and hands messages over to it."""

from __future__ import annotations

import json
import os
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Mapping
from contextlib import closing, suppress
from pathlib import Path
from struct import Struct

from agents.hosting.interrupts import received_by
from agents.hosting.link_protocol import readable
from apad_bridge.records.journal import await_beginning
from apad_bridge.records.run_directory import RunDirectory, RunDirectoryError
from apad_bridge.ros2.followed_run import FollowedRun
from apad_bridge.ros2.topics import EVENTS_KEPT, RunTopics, TopicMessage, hash_of
from apad_bridge.scenario.errors import UserError

ENVIRONMENT = Path(sys.prefix).with_name(".venv-ros2")
"""launch_scripts/install --ros2 makes it, beside that of musselbed, and writes the file `installed` once it is whole."""
RECORD = Struct("<II")
NEW_TOPIC = 0xFFFFFFFF
"""`publisher.py` has both, too, because it imports nothing of ours."""
_PROGRAM = Path(__file__).with_name("publisher.py")
_STARTS_S = 60.0
_TAKES_S = 10.0
_END_S = 5.0
_OF_OTHER_ROS = ("LD_LIBRARY_PATH", "AMENT_PREFIX_PATH", "COLCON_PREFIX_PATH", "CMAKE_PREFIX_PATH")
"""A setup file of ROS sets them, and its libraries would take the place of the environment's own."""
_DISCOVERY = ("ROS_AUTOMATIC_DISCOVERY_RANGE", "ROS_LOCALHOST_ONLY", "ROS_STATIC_PEERS")


class Ros2Gone(Exception):
    """The process that publishes has ended, or takes nothing any more; the text is one line."""


def require_ros2() -> None:
    """UserError with the mend where ROS 2 is not installed for musselbed."""
    if not (ENVIRONMENT / "installed").exists():
        raise UserError("ROS 2 is not installed for musselbed: run launch_scripts/install --ros2")


class Ros2Process:
    """Owned by one thread."""

    def __init__(self, node: str) -> None:
        """`node` is its node's name. Ros2Gone when it does not come up."""
        self._numbers: dict[str, int] = {}
        self._link, far = socket.socketpair()
        self._link.settimeout(_TAKES_S)
        with far:
            self._process = subprocess.Popen(
                [str(ENVIRONMENT / "bin" / "python"), "-I", str(_PROGRAM), node],
                stdin=far.fileno(),
                stdout=subprocess.PIPE,
                env=environment(os.environ),
                start_new_session=True,
            )
        assert self._process.stdout is not None
        answers = readable(self._process.stdout.fileno(), _STARTS_S)
        if not answers or self._process.stdout.readline() != b"ready\n":
            self.close()
            raise Ros2Gone("ROS 2 does not start: its reason stands above")

    def publish(self, it: TopicMessage) -> None:
        """Hands one message over. Ros2Gone."""
        if it.topic not in self._numbers:
            self._numbers[it.topic] = len(self._numbers)
            self._announce(it, self._numbers[it.topic])
        self._send(self._numbers[it.topic], it.data)

    def close(self) -> None:
        """Ends the process, which ends at its input's end."""
        self._link.close()
        assert self._process.stdout is not None
        self._process.stdout.close()
        with suppress(subprocess.TimeoutExpired):
            self._process.wait(_END_S)
        self._process.kill()
        self._process.wait()

    def _announce(self, it: TopicMessage, number: int) -> None:
        told = {"number": number, "topic": it.topic, "kind": it.kind, "kept": it.kept}
        self._send(NEW_TOPIC, json.dumps({**told, "hexadecimal": hash_of(it.kind)}).encode())

    def _send(self, number: int, data: bytes) -> None:
        try:
            self._link.sendall(RECORD.pack(number, len(data)) + data)
        except OSError as error:
            raise Ros2Gone(f"the process that publishes on ROS 2 takes nothing any more: {error}") from error


def environment(outer: Mapping[str, str]) -> dict[str, str]:
    """The environment of the process: Fast DDS, which the wheels have, and by default for this machine alone."""
    inner = {name: value for name, value in outer.items() if name not in _OF_OTHER_ROS}
    if not any(name in inner for name in _DISCOVERY):
        inner["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
    return {**inner, "RMW_IMPLEMENTATION": "rmw_fastrtps_cpp"}


# Shows a run on ROS 2 until a person ends it: a process of its own, as a console is, that reads the journal.
_NICE = 5
"""Above the supervisor's: a viewer may wait for its processor, and a tick of the flight may not."""
_POLL_S = 0.1
_SHOW_S = 1.0
"""Wall seconds between two messages of a topic, but for /clock and the events."""


def serve(run_dir: Path, began: Callable[[RunTopics], None], tell: Callable[[str], None]) -> None:
    """Publishes until SIGINT or SIGTERM. `began` is called once all topics have their first message.

    `tell` takes lines for a person. RunDirectoryError for no run, or one that cannot be shown; Ros2Gone.
    """
    directory = RunDirectory.created(run_dir)
    scenario = directory.load_scenario()
    asked = threading.Event()
    os.nice(_NICE)
    with received_by(asked.set):
        if not await_beginning(directory, asked.is_set, tell):
            return
        RunDirectory.open(run_dir)
        try:
            run = FollowedRun(directory, scenario)
        except (OSError, ValueError) as error:
            raise RunDirectoryError(f"{run_dir}: cannot be shown: {error}") from error
        topics = RunTopics(scenario, run)
        with closing(run), closing(Ros2Process(topics.node)) as ros2:
            _Show(run, topics, ros2).run(asked, began, tell)


class _Show:
    def __init__(self, run: FollowedRun, topics: RunTopics, ros2: Ros2Process) -> None:
        self._run = run
        self._topics = topics
        self._ros2 = ros2
        self._shown_ms = -1

    def run(
        self, asked: threading.Event, began: Callable[[RunTopics], None], tell: Callable[[str], None]
    ) -> None:
        self._publish_events()
        self._publish_state()
        self._ros2.publish(self._topics.fixed_frames())
        began(self._topics)
        next_s, has_sent_end = time.monotonic() + _SHOW_S, False
        while not asked.wait(_POLL_S):
            self._publish_events()
            if time.monotonic() >= next_s:
                next_s = max(next_s + _SHOW_S, time.monotonic())
                self._publish_state()
            if self._run.state.ended_by is not None and not has_sent_end:
                has_sent_end = True
                tell(f"the run has ended: {self._run.state.ended_by}; its end is shown until Ctrl-C")

    def _publish_events(self) -> None:
        """Publishes what is new, after the time at which it is."""
        new = self._run.poll()
        if new and not self._run.has_wall_time:
            self._ros2.publish(self._topics.clock())
        for it in list(self._topics.events(new))[-EVENTS_KEPT:]:
            self._ros2.publish(it)

    def _publish_state(self) -> None:
        """Publishes the state if time has passed: a tree of frames takes no second picture of one time."""
        if self._run.now_ms == self._shown_ms:
            return
        self._shown_ms = self._run.now_ms
        if not self._run.has_wall_time:
            self._ros2.publish(self._topics.clock())
        for it in self._topics.state():
            self._ros2.publish(it)
