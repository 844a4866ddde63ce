"""Publishes /clock on a master that a person started, so that a simulated aPad there can fly faster than the wall clock.

    python -m apad_bridge.ros.system.clock_node [--speed X]

The launch files start it beside the simulated aPad, and set /use_sim_time. `musselbed run` itself never publishes a clock
on a master that it did not start, and this node refuses to when another one does already. SIGTERM or SIGINT ends it.
"""

from __future__ import annotations

import argparse
import sys
import time

import rosgraph
import rospy
from rosgraph_msgs.msg import Clock

from agents.hosting import interrupts
from agents.hosting.started import outlive_starter
from apad_bridge.ros.system.handshakes import bound_handshakes
from apad_bridge.ros.system.ros_time import to_ros
from apad_bridge.ros_names.names import CLOCK
from apad_bridge.supervisor.clock import StopSign

NODE = "musselbed_clock"
_PERIOD_S = 0.02
"""Wall seconds: at speed 20 that is 0.4 s of mission time, and the supervisor acts once a second of it."""


def stamp_ms(start_ms: int, elapsed_s: float, speed: float) -> int:
    """The clock's time `elapsed_s` wall seconds after `start_ms`."""
    return start_ms + int(elapsed_s * 1000 * speed)


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
        topic = rospy.Publisher(CLOCK, Clock, queue_size=10)
        # It begins at the time of day, because a zero means "no time yet" to ROS.
        start_ms, start_s = time.time_ns() // 1_000_000, time.monotonic()
        while not stop.wait(_PERIOD_S) and not rospy.is_shutdown():
            topic.publish(Clock(to_ros(stamp_ms(start_ms, time.monotonic() - start_s, speed))))
    rospy.signal_shutdown("asked to end")
    return 0


def _join_graph() -> str | None:
    """Makes this process a node, or returns the reason why there can be none."""
    node = rospy.resolve_name(NODE)
    publishers, _, _ = rosgraph.Master(node).getSystemState()
    others = {node for topic, nodes in publishers if topic == CLOCK for node in nodes} - {node}
    if others:
        return f"/clock comes from {', '.join(sorted(others))} already: end it first"
    bound_handshakes()
    rospy.init_node(NODE, argv=[], disable_signals=True)
    return None


if __name__ == "__main__":
    sys.exit(main())
