"""The heartbeat to the vehicle's watchdog: each tick, as long as this end hears where the aPad is."""

from __future__ import annotations

import rospy
from std_msgs.msg import Float32

from apad_bridge.ros_names.names import ours
from apad_bridge.supervisor.context import Watcher
from apad_bridge.supervisor.core import Supervisor

STALE_MS = 3_000
"""With an older position no heartbeat goes out: a bench that is blind flies nothing, whatever else it publishes."""


class Heartbeat:
    """Its number is the age of the aPad's newest position, in seconds of mission time."""

    def __init__(self) -> None:
        self._topic = rospy.Publisher(ours("heartbeat"), Float32, queue_size=1)

    def watcher(self, supervisor: Supervisor) -> Watcher:
        def watch(now_ms: int) -> None:
            age_s = age_of(None if supervisor.pose is None else supervisor.pose.at_ms, now_ms)
            if age_s is not None:
                self._topic.publish(Float32(age_s))

        return watch


def age_of(heard_ms: int | None, now_ms: int) -> float | None:
    """Seconds since a position, or None where there is none or it is stale."""
    if heard_ms is None or now_ms - heard_ms > STALE_MS:
        return None
    return max(0, now_ms - heard_ms) / 1000
