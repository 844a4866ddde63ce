"""An ordinary rospy node that subscribes to some aMussels' positions and measures each report's delay after its tick.

Use: rospy_reader.py AGENT_ID...; prints `reading`; at the end of stdin a line of JSON with the latencies in milliseconds.
"""

from __future__ import annotations

import json
import sys
import time
from typing import Any

import rospy

from apad_bridge.ros.types.messages import use_generated_messages

use_generated_messages()

from auv_msgs.msg import NavSts  # noqa: E402

from benchmarks.nodes.gateway import LAP_S  # noqa: E402


class PositionReader:
    def __init__(self, agent_id: int) -> None:
        self.latencies_ms: list[float] = []
        self._stamp: Any = None
        self._subscriber = rospy.Subscriber(
            f"/amussel{agent_id}/position", NavSts, self._receive, tcp_nodelay=True
        )

    def _receive(self, message: Any) -> None:
        now_s = time.monotonic()
        if message.header.stamp != self._stamp:
            self._stamp = message.header.stamp
            self.latencies_ms.append(1000 * ((now_s - message.position.north) % LAP_S))


def main() -> None:
    rospy.init_node("reader", disable_signals=True)
    readers = [PositionReader(int(agent_id)) for agent_id in sys.argv[1:]]
    print("reading", flush=True)
    sys.stdin.read()
    print(json.dumps([latency for reader in readers for latency in reader.latencies_ms]), flush=True)
    rospy.signal_shutdown("told to end")


if __name__ == "__main__":
    main()
