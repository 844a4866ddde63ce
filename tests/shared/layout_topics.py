"""Finds the live topics in a layout of any program."""

from __future__ import annotations

import re

TYPES = {
    "markers": "visualization_msgs/MarkerArray",
    "plan": "nav_msgs/Path",
    "path": "nav_msgs/Path",
    "battery_state": "sensor_msgs/BatteryState",
    "apad": "musselbed_msgs/APadStatus",
    "diagnostics": "diagnostic_msgs/DiagnosticArray",
}
"""The message types, by the last part of a topic's name."""


def named_topics(text: str) -> set[str]:
    return set(re.findall(rf"/(?:[a-z]\w*/)*(?:{'|'.join(TYPES)})\b", text))
