"""A mission's ends of the topics heard, said and claims, and an aPad's modem: prints what comes as JSON lines, and says
each line of its stdin.

Use: beside_a_bridge.py, on the master at ROS_MASTER_URI; a line of stdin is [aMussel, medium, bytes as hexadecimal digits].
The medium "modem" is for what the aPad's modem hears from an unknown sender. "connected" is answered when a bridge's topic
has reached this node.
"""

from __future__ import annotations

import json
import sys
import threading
from typing import Any

import rospy

from apad_bridge.ros.types.messages import use_generated_messages

use_generated_messages()

from musselbed_msgs.msg import FleetClaim, Packet  # noqa: E402
from uuv_sensor_msgs.msg import AcousticModemPayload, AcousticModemRequest  # noqa: E402


def main() -> None:
    def show(kind: str, *found: Any) -> None:
        print(json.dumps([kind, *found]), flush=True)

    pause = threading.Event()
    rospy.init_node("mission", disable_signals=True)
    said = rospy.Publisher("/musselbed/said", Packet, queue_size=10)
    heard = rospy.Subscriber(
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
    modem = rospy.Publisher("/apad1/acoustic_payload", AcousticModemPayload, queue_size=10)
    rospy.Subscriber(
        "/apad1/acoustic_request",
        AcousticModemRequest,
        lambda it: show("request", it.id, it.req_type, bytes(it.msg).hex()),
    )
    show("ready")
    for line in sys.stdin:
        agent_id, medium, data = json.loads(line)
        reached = {"connected": heard, "modem": modem}.get(medium, said)
        while not reached.get_num_connections():
            pause.wait(0.02)
        if medium == "connected":
            show("connected")
        elif medium == "modem":
            modem.publish(AcousticModemPayload(msg=bytes.fromhex(data), sender_id=-1))
        else:
            said.publish(Packet(agent=agent_id, medium=medium, data=bytes.fromhex(data)))


if __name__ == "__main__":
    main()
