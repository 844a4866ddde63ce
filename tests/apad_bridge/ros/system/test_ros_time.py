"""The stamps of our messages: mission time on a master of our own, the master's time on somebody else's."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from typing import Any

import genpy
import pytest

ros_pace = pytest.importorskip("apad_bridge.ros.system.ros_pace")
ros_time = pytest.importorskip("apad_bridge.ros.system.ros_time")


@pytest.fixture
def master(monkeypatch: pytest.MonkeyPatch) -> Iterator[list[genpy.Time]]:
    """The time of the master, as its only element."""
    time = [genpy.Time(1_800_000_000, 250_000_000)]
    monkeypatch.setattr(ros_time.rospy, "get_rostime", lambda: time[0])
    monkeypatch.setattr(ros_time, "_offset_ms", 0)
    yield time


class Pace:
    behind_s = 1.5

    def reach(self, *_: Any) -> None:
        pass


def test_stamps_are_mission_time_until_the_master_is_somebody_elses(master: list[genpy.Time]) -> None:
    assert ros_time.stamp(61_500) == genpy.Time(61, 500_000_000)
    pace = ros_pace.StampedByMaster(Pace(), 0)
    assert ros_time.stamp(0) == master[0], "from the first event on"
    master[0] = genpy.Time(1_800_000_001, 260_000_000)
    pace.reach(1000, None)
    assert ros_time.stamp(1000) == master[0] and pace.behind_s == 1.5
    # A belief's stamp is that of its packet, 400 ms before the tick.
    assert ros_time.stamp(600) == genpy.Time(1_800_000_000, 860_000_000)


@pytest.mark.parametrize(
    ("time", "stamp_ms"),
    [((1_800_000_000, 250_000_000), 1_800_000_000_250), ((0, 0), 0)],
    ids=["runs", "has not begun"],
)
def test_before_a_node_is_on_somebody_elses_master_and_its_clock_has_begun_there_is_no_time(
    master: list[genpy.Time], time: tuple[int, int], stamp_ms: int
) -> None:
    master[0] = genpy.Time(*time)
    ros_time.await_master()
    assert ros_time.stamp(61_500) == genpy.Time() and ros_time.stamp_ms(61_500) == 0
    ros_pace.StampedByMaster(Pace(), 61_500)
    assert ros_time.stamp(61_500) == master[0] and ros_time.stamp_ms(61_500) == stamp_ms
    assert stamp_ms or ros_time.stamp(60_500) == genpy.Time()


def test_an_arrival_is_told_by_the_masters_clock_where_there_is_one_and_else_by_one_that_nobody_sets(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A vehicle on a simulator's /clock stamps its positions by it, and that clock may run at any rate."""
    rostime = ros_time.rospy.rostime
    before_ms = math.floor(1000 * time.monotonic())
    assert before_ms <= ros_time.arrival_ms() <= math.ceil(1000 * time.monotonic())
    monkeypatch.setattr(rostime, "_rostime_initialized", True)
    monkeypatch.setattr(rostime, "_rostime_current", rostime.Time(12, 500_000_000))
    assert ros_time.arrival_ms() == 12_500
