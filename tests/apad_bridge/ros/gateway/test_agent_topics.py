"""The rate of an aMussel's position, by a clock that the test sets."""

from __future__ import annotations

import queue
from collections.abc import Iterator
from contextlib import suppress
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

    def comes(self, patience_s: float = PATIENCE_S) -> Any:
        """The next position; None where none comes in time."""
        with suppress(queue.Empty):
            return self.positions.get(timeout=patience_s)
        return None


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


LEAPS: dict[str, list[tuple[int, bool]]] = {
    # The master's time, by its last, and if it is silent after the one position that has come.
    "it comes ten times a second of the master's time": [*[(100, False)] * 19, (100, True)],
    # At a high speed /clock comes in steps of up to a second; the same report ten times at once says nothing more.
    "a clock that leaps brings one position a leap": [(5_000, True), (60_000, True)],
    "a clock that began anew brings one, and goes on": [(-40_000, True), (100, False)],
}


@pytest.mark.parametrize("leaps", LEAPS.values(), ids=LEAPS)
def test_the_same_position_comes_again_with_its_stamp(
    master: Master, topics: AgentTopics, leaps: list[tuple[int, bool]]
) -> None:
    """None comes while the master's time stands, as on a clock that is slower than the wall's, or for 99 ms of it."""
    topics.show(1000, {7: AgentReport(1.0, 2.0, 3.0, 0.5)})
    assert master.comes().position.depth == 3.0 and master.comes(LONG_S) is None
    for leap_ms, is_silent in leaps:
        master.now_ms += leap_ms
        assert master.comes().header.stamp == to_ros(1000)
        assert not is_silent or master.comes(LONG_S) is None
    master.now_ms += 99
    assert master.comes(LONG_S) is None
