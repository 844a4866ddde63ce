"""Publishes /clock on a master that a person started, so that a simulated aPad there can fly faster than the wall clock.

    python -m apad_bridge.ros.system.clock_node [--speed X]

Simulated aPads' nodes and supervisors that follow it publish on /clock_reached how far they have come. The clock waits for
the slowest of them (`paced_clock.py`), so on a busy machine it is slower than `--speed`. Standard error names one that is
waited for no more.

The launch files start it beside the simulated aPad, and set /use_sim_time. `musselbed run` publishes a clock on its own
master alone (`ros_pace.py`), and this node refuses to when another one does already. SIGTERM or SIGINT ends it.
"""

from __future__ import annotations

import argparse
import math
import sys
import time

import rosgraph
import rospy
from rosgraph_msgs.msg import Clock

from agents.hosting import interrupts
from agents.hosting.started import outlive_starter
from apad_bridge.doctor.graph_checks import Graph
from apad_bridge.doctor.network import Unreachable
from apad_bridge.ros.system.inbox import Inbox
from apad_bridge.ros.system.node import start_node
from apad_bridge.ros.system.paced_clock import PATIENCE_S, PacedClock
from apad_bridge.ros.system.ros_time import to_ms, to_ros
from apad_bridge.ros_names.names import CLOCK, CLOCK_REACHED
from apad_bridge.supervisor.clock import StopSign

NODE = "musselbed_clock"
_PERIOD_S = 0.02
"""Wall seconds: at speed 20 that is 0.4 s of mission time, and the supervisor acts once a second of it."""
_REPEAT_S = 0.2
"""Wall seconds after which a clock that waits is published again: a connection that ended is noticed by writing to it."""


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m apad_bridge.ros.system.clock_node", description=__doc__)
    parser.add_argument(
        "--speed", type=float, default=1.0, metavar="X", help="as fast as the wall clock, times X"
    )
    speed: float = parser.parse_args().speed
    if speed <= 0:
        parser.error(f"--speed must be above 0, not {speed:g}")
    try:
        with interrupts.interruptible():  # rospy waits for its master for ever
            refusal = _join_graph()
    except KeyboardInterrupt:
        return interrupts.INTERRUPTED
    if refusal is not None:
        print(f"musselbed: {refusal}", file=sys.stderr)
        return 3
    outlive_starter()
    stop = StopSign()
    with interrupts.received_by(stop.set):
        _publish(speed, stop)
    rospy.signal_shutdown("asked to end")
    return 0


def _publish(speed: float, stop: StopSign) -> None:
    reached: Inbox[tuple[str, int]] = Inbox()
    topic = rospy.Publisher(CLOCK, Clock, queue_size=10)
    rospy.Subscriber(
        CLOCK_REACHED,
        Clock,
        lambda message: reached.put((message._connection_header["callerid"], to_ms(message.clock))),
        tcp_nodelay=True,
    )
    # It begins at the time of day, because a zero means "no time yet" to ROS.
    clock = PacedClock(time.time_ns() // 1_000_000, speed)
    published_ms, published_s, last_s = 0, -math.inf, time.monotonic()
    while not stop.wait(_PERIOD_S) and not rospy.is_shutdown():
        now_s = time.monotonic()
        for name, reached_ms in reached.take():
            if clock.hear(name, reached_ms):
                _say(f"/clock waits for {name} again: it is heard")
        # Each follower reads /clock, and the kernel closes the connection of one that was killed.
        clock.keep({it.endpoint_id for it in topic.impl.connections})
        for name in clock.advance(now_s - last_s):
            _say(f"/clock does not wait for {name} any more: it came no further for {PATIENCE_S:g} s")
        last_s = now_s
        if clock.now_ms > published_ms or now_s - published_s >= _REPEAT_S:
            topic.publish(Clock(to_ros(clock.now_ms)))
            published_ms, published_s = clock.now_ms, now_s


def _say(text: str) -> None:
    print(f"musselbed: {text}", file=sys.stderr, flush=True)


def _join_graph() -> str | None:
    """Makes this process a node, or returns the reason why there can be none."""
    node = rospy.resolve_name(NODE)
    try:
        graph = Graph.read(rosgraph.get_master_uri())
    except Unreachable as error:
        return str(error)
    if others := set(graph.publishers.get(CLOCK, ())) - {node}:
        return f"/clock comes from {', '.join(sorted(others))} already: end it first"
    start_node(NODE)
    return None


if __name__ == "__main__":
    sys.exit(main())
