"""Shows a run on ROS 2 until a person ends it: a process of its own, as a console is, that reads the journal."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

from agents.hosting.interrupts import received_by
from apad_bridge.records.journal import await_beginning
from apad_bridge.records.run_directory import RunDirectory, RunDirectoryError
from apad_bridge.ros2.followed_run import FollowedRun
from apad_bridge.ros2.ros2_process import Ros2Process
from apad_bridge.ros2.topics import EVENTS_KEPT, RunTopics
from apad_bridge.scenario.errors import ScenarioError
from apad_bridge.scenario.loader import load

_NICE = 5
"""Above the supervisor's: a viewer may wait for its processor, and a tick of the flight may not."""
_POLL_S = 0.1
_SHOW_S = 1.0
"""Wall seconds between two messages of a topic, but for /clock and the events."""


def serve(run_dir: Path, began: Callable[[RunTopics], None], tell: Callable[[str], None]) -> None:
    """Publishes until SIGINT or SIGTERM. `began` is called once all topics have their first message.

    `tell` takes lines for a person. RunDirectoryError for no run, or one that cannot be shown; Ros2Gone.
    """
    directory = RunDirectory(run_dir)
    asked = threading.Event()
    os.nice(_NICE)
    if not directory.scenario.is_file():
        raise RunDirectoryError(f"{run_dir}: no run: it has no scenario.yaml")
    with received_by(asked.set):
        if not await_beginning(directory, asked.is_set, tell):
            return
        RunDirectory.open(run_dir)
        try:
            scenario = load(directory.scenario)
            run = FollowedRun(directory, scenario)
        except ScenarioError as error:
            raise RunDirectoryError(error.lines[0]) from error
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
        next_s, has_told_end = time.monotonic() + _SHOW_S, False
        while not asked.wait(_POLL_S):
            self._publish_events()
            if time.monotonic() >= next_s:
                next_s = max(next_s + _SHOW_S, time.monotonic())
                self._publish_state()
            if self._run.state.ended_by is not None and not has_told_end:
                has_told_end = True
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
