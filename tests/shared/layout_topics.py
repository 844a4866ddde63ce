"""The live topics that a layout names, whichever program it is for."""

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
"""By the last part of a topic's name."""


def named_topics(text: str) -> set[str]:
    return set(re.findall(rf"/(?:[a-z]\w*/)*(?:{'|'.join(TYPES)})\b", text))
