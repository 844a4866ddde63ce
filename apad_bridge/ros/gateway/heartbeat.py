"""The heartbeat to the vehicle's watchdog: each tick, as long as this end hears the aPad and can stop it."""

from __future__ import annotations

from collections.abc import Callable

import rospy
from std_msgs.msg import Float32

from apad_bridge.ros_names.names import ours
from apad_bridge.supervisor.context import Watcher
from apad_bridge.supervisor.core import Supervisor
from apad_bridge.vehicle.guards.stops import StopKind, Stops

STALE_MS = 3_000
"""With an older position no heartbeat goes out: a bench that is blind flies nothing, whatever else it publishes."""
OFF = -1.0
"""The number of a heartbeat while an OFF is in force: the watchdog then keeps the thrusters off in a silence, too."""


class Heartbeat:
    """Its number is the age of the aPad's newest position, in seconds of mission time, or `OFF`.

    No heartbeat goes out while `can_stop` is False: a bench from which no order reaches the vehicle is as good as silent.
    """

    def __init__(self, stops: Stops, can_stop: Callable[[], bool]) -> None:
        self._stops = stops
        self._can_stop = can_stop
        self._topic = rospy.Publisher(ours("heartbeat"), Float32, queue_size=1)

    def watcher(self, supervisor: Supervisor) -> Watcher:
        def watch(now_ms: int) -> None:
            age_s = age_of(None if supervisor.pose is None else supervisor.pose.at_ms, now_ms)
            if age_s is None or not self._can_stop():
                return
            stop = self._stops.in_force
            is_off = stop is not None and stop.kind is StopKind.OFF
            self._topic.publish(Float32(OFF if is_off else age_s))

        return watch


def age_of(heard_ms: int | None, now_ms: int) -> float | None:
    """Seconds since a position, or None where there is none or it is stale."""
    if heard_ms is None or now_ms - heard_ms > STALE_MS:
        return None
    return max(0, now_ms - heard_ms) / 1000
