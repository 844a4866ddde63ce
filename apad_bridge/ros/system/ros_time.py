"""Converts integer milliseconds to ROS time and back, and decides the stamps of our messages, here and nowhere else.

On a master that we started, /clock is mission time, and so is every stamp. On somebody else's master mission time begins at
0 while the other nodes have that master's time: stamps there are its time, by the offset at the newest tick. The headers
in a run's bag have the same stamps; the bag's own times are mission time.
"""

from __future__ import annotations

import time

import genpy
import rospy

_offset_ms: int | None = 0
"""The master's time minus mission time; None while it is not known. A process has one node, so it has one master."""


def to_ros(at_ms: int) -> genpy.Time:
    return genpy.Time(at_ms // 1000, at_ms % 1000 * 1_000_000)


def to_ms(stamp: genpy.Time) -> int:
    """Whole milliseconds, rounded down."""
    return int(stamp.secs * 1000 + stamp.nsecs // 1_000_000)


def arrival_ms() -> int:
    """The present time for differences, in ms: by the master's /clock, else by a wall clock that nobody sets."""
    return round(1000 * time.monotonic()) if rospy.rostime.is_wallclock() else to_ms(rospy.get_rostime())


def follow_master(now_ms: int) -> None:
    """From now on mission time `now_ms` is stamped with the master's present time: its /clock, or the wall clock."""
    global _offset_ms
    _offset_ms = to_ms(rospy.get_rostime()) - now_ms


def await_master() -> None:
    """From now on stamps are 0, no time, until `follow_master`: the process has somebody else's master, and no node yet."""
    global _offset_ms
    _offset_ms = None


def stamp_ms(at_ms: int) -> int:
    """The stamp, in ms, of a message about mission time `at_ms`. 0, no time, before a master with a /clock has sent one."""
    return 0 if _offset_ms is None else max(0, at_ms + _offset_ms)


def stamp(at_ms: int) -> genpy.Time:
    return to_ros(stamp_ms(at_ms))
