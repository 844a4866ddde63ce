"""The rate of an aMussel's position, by a clock that the test sets."""

from __future__ import annotations

import queue
from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any

import genpy
import pytest

from apad_bridge.ros.gateway import agent_topics
from apad_bridge.ros.gateway.agent_topics import AgentReport, AgentTopics
from apad_bridge.ros.system.ros_time import to_ros

PATIENCE_S = 60.0
LONG_S = 0.4
"""Four periods of a position by the wall clock."""


class Master:
    """The master's time, and the topics on it with a reader each."""

    def __init__(self) -> None:
        self.now_ms = 50_000
        self.positions: queue.Queue[Any] = queue.Queue()

    def publisher(self, topic: str, *_: Any) -> Any:
        put = self.positions.put if topic.endswith("position") else lambda message: None
        return SimpleNamespace(publish=put, get_num_connections=lambda: 1)

    def get_rostime(self) -> genpy.Time:
        return to_ros(self.now_ms)

    @property
    def stands_silent(self) -> bool:
        try:
            self.positions.get(timeout=LONG_S)
        except queue.Empty:
            return True
        return False


@pytest.fixture
def master(monkeypatch: pytest.MonkeyPatch) -> Master:
    master = Master()
    monkeypatch.setattr(agent_topics, "never_blocking_publisher", master.publisher)
    monkeypatch.setattr(agent_topics, "rospy", master)
    return master


@pytest.fixture
def topics(master: Master) -> Iterator[AgentTopics]:
    topics = AgentTopics([7])
    yield topics
    topics.close()


def test_a_position_comes_ten_times_a_second_of_the_masters_time(master: Master, topics: AgentTopics) -> None:
    topics.show(1000, {7: AgentReport(1.0, 2.0, 3.0, 0.5)})
    assert master.positions.get(timeout=PATIENCE_S).position.depth == 3.0
    assert master.stands_silent, "while its time stands, as on a clock that is slower than the wall's"
    for _ in range(20):
        master.now_ms += 100
        repeated = master.positions.get(timeout=PATIENCE_S)
    assert repeated.header.stamp == to_ros(1000)
    master.now_ms += 99
    assert master.stands_silent


def test_a_clock_that_leaps_brings_one_position_a_leap(master: Master, topics: AgentTopics) -> None:
    """At a high speed /clock comes in steps of up to a second; the same report ten times at once says nothing more."""
    topics.show(1000, {7: AgentReport(1.0, 2.0, 3.0, 0.5)})
    master.positions.get(timeout=PATIENCE_S)
    for leap_ms in (5_000, 60_000):
        master.now_ms += leap_ms
        master.positions.get(timeout=PATIENCE_S)
        assert master.stands_silent
    master.now_ms = 10_000
    master.positions.get(timeout=PATIENCE_S)
    assert master.stands_silent, "a clock that began anew"
    master.now_ms += 100
    master.positions.get(timeout=PATIENCE_S)
