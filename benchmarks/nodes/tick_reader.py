"""An ordinary rospy node that notes when each tick's beliefs arrive.

Use: tick_reader.py; prints `reading`; at the end of stdin a line of JSON: [mission second, monotonic second] for each tick.
"""

from __future__ import annotations

import json
import sys
import time
from typing import Any

import rospy

from apad_bridge.ros.types.messages import use_generated_messages

use_generated_messages()

from musselbed_msgs.msg import FleetBeliefs  # noqa: E402


def main() -> None:
    rospy.init_node("tick_reader", disable_signals=True)
    ticks: list[tuple[float, float]] = []

    def receive(message: Any) -> None:
        ticks.append((message.mission_time_ms / 1000, time.monotonic()))

    rospy.Subscriber("/musselbed/beliefs", FleetBeliefs, receive, tcp_nodelay=True)
    print("reading", flush=True)
    sys.stdin.read()
    print(json.dumps(ticks), flush=True)
    rospy.signal_shutdown("told to end")


if __name__ == "__main__":
    main()
