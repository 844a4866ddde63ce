"""Converts integer milliseconds to ROS time and back, here and nowhere else."""

from __future__ import annotations

import genpy


def to_ros(at_ms: int) -> genpy.Time:
    return genpy.Time(at_ms // 1000, at_ms % 1000 * 1_000_000)


def to_ms(stamp: genpy.Time) -> int:
    """Whole milliseconds, rounded down."""
    return int(stamp.secs * 1000 + stamp.nsecs // 1_000_000)
