"""A mission's ends of the topics heard, said and claims: prints what comes as JSON lines, and says each line of its stdin.

Use: beside_a_bridge.py, on the master at ROS_MASTER_URI; a line of stdin is [aMussel, medium, bytes as hexadecimal digits].
"""

from __future__ import annotations

import json
import sys
from typing import Any

import rospy

from apad_bridge.ros.types.messages import use_generated_messages

use_generated_messages()

from musselbed_msgs.msg import FleetClaim, Packet  # noqa: E402


def main() -> None:
    def show(kind: str, *found: Any) -> None:
        print(json.dumps([kind, *found]), flush=True)

    rospy.init_node("mission", disable_signals=True)
    said = rospy.Publisher("/musselbed/said", Packet, queue_size=10)
    rospy.Subscriber(
        "/musselbed/heard",
        Packet,
        lambda it: show(
            "heard",
            it.agent,
            it.medium,
            bytes(it.data).hex(),
            it.mission_time_ms,
            it.header.stamp.to_sec() - rospy.get_time(),
        ),
    )
    rospy.Subscriber(
        "/musselbed/claims", FleetClaim, lambda it: show("claim", it.node, it.real, list(it.ids))
    )
    show("ready")
    for line in sys.stdin:
        agent_id, medium, data = json.loads(line)
        said.publish(Packet(agent=agent_id, medium=medium, data=bytes.fromhex(data)))


if __name__ == "__main__":
    main()
