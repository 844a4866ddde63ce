"""The heartbeat to the vehicle's watchdog: each tick, as long as this end hears the aPad and can stop it. And what the
watchdog says of itself.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import rosgraph
import rospy
from std_msgs.msg import Float32, String

from apad_bridge.doctor.graph_checks import Graph
from apad_bridge.doctor.network import Unreachable
from apad_bridge.doctor.preflight_checks import second_bench
from apad_bridge.events.guard_events import StopKind
from apad_bridge.ros.gateway.fleet_guard import SecondFleet
from apad_bridge.ros.system.inbox import Listening
from apad_bridge.ros.types.any_listener import AnyListener
from apad_bridge.ros_names.names import of_apad, ours
from apad_bridge.supervisor.context import Watcher
from apad_bridge.supervisor.supervisor import Supervisor
from apad_bridge.vehicle.guards.gate import Gate
from apad_bridge.vehicle.guards.stops import Stops

STALE_MS = 3_000
"""With an older position no heartbeat goes out but that of an OFF: a bench that is blind flies nothing."""
OFF = -1.0
"""The number of a heartbeat while an OFF is in force: the watchdog then keeps the thrusters off in a silence, too."""


class Heartbeat:
    """Its number is the age of the aPad's newest position, in seconds of mission time, or `OFF`.

    No heartbeat goes out while `can_stop` is False: a bench from which no order reaches the vehicle is as good as silent.
    """

    def __init__(self, stops: Stops, can_stop: Callable[[], bool]) -> None:
        """Raises SecondFleet where another living node publishes the topic: that bench flies the same vehicle."""
        _refuse_second_bench(rospy.resolve_name(ours("heartbeat")))
        self._stops = stops
        self._can_stop = can_stop
        self._topic = rospy.Publisher(ours("heartbeat"), Float32, queue_size=1)

    def watcher(self, supervisor: Supervisor) -> Watcher:
        def watch(now_ms: int) -> None:
            stop = self._stops.in_force
            is_off = stop is not None and stop.kind is StopKind.OFF
            pose = supervisor.pose
            number = number_of(None if pose is None else pose.at_ms, now_ms, is_off=is_off)
            if number is not None and self._can_stop():
                self._topic.publish(Float32(number))

        return watch


class WatchdogStates(Listening[str]):
    """Brings the gate what the watchdog of the aPad called `name` says: rospy's threads queue it, the flight's takes it."""

    def __init__(self, name: str, gate: Gate) -> None:
        super().__init__()
        self._gate = gate
        listener = AnyListener(self._inbox.refuse)
        self._subscribers = [listener.listen(of_apad(name, "watchdog"), String, ("data",), self._take)]

    def watch(self, now_ms: int) -> None:
        self._gate.hear_watchdog(self._inbox.take(), now_ms)

    def _take(self, message: Any) -> None:
        self._inbox.put(str(message.data))


def _refuse_second_bench(topic: str) -> None:
    """A node that does not answer counts as living. A master that does not is told of elsewhere."""
    try:
        living = Graph.read(rosgraph.get_master_uri()).living_publishers(topic)
    except Unreachable:
        return
    if others := [it for it in living if it != rospy.get_name()]:
        raise SecondFleet(": ".join(second_bench(topic, others)))


def number_of(heard_ms: int | None, now_ms: int, *, is_off: bool) -> float | None:
    """The seconds since a position, or `OFF`; None without a position of `STALE_MS` or younger, unless an OFF is in force.

    An OFF needs no position, and a lossy link brings none: were it silent, the watchdog would hold, and the thrusters turn.
    """
    if is_off:
        return OFF
    return None if heard_ms is None or now_ms - heard_ms > STALE_MS else max(0, now_ms - heard_ms) / 1000
