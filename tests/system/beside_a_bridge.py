"""A mission's ends of the topics heard, said and claims, and an aPad's modem: prints what comes as JSON lines, and says
each line of its stdin.

Use: beside_a_bridge.py, on the master at ROS_MASTER_URI; a line of stdin is [aMussel, medium, bytes as hexadecimal digits].
The medium "modem" is for what the aPad's modem hears from an unknown sender. "connected" is answered when the bridge whose
lowest aMussel is named publishes to this node.
"""

from __future__ import annotations

import json
import sys
import threading
from typing import Any
from xmlrpc.client import ServerProxy

import rosgraph
import rospy

from apad_bridge.ros.types.messages import use_generated_messages

use_generated_messages()

from musselbed_msgs.msg import FleetClaim, Packet  # noqa: E402
from uuv_sensor_msgs.msg import AcousticModemPayload, AcousticModemRequest  # noqa: E402


def publishes_to_us(agent_id: int) -> bool:
    """True once the bridge itself has the connection: a subscriber of rospy counts one before it is made."""
    uri = rosgraph.Master("/mission").lookupNode(f"/musselbed_bridge_{agent_id}")
    _, _, connections = ServerProxy(uri).getBusInfo("/mission")
    return any(it[2] == "o" and it[4] == "/musselbed/heard" for it in connections)


def main() -> None:
    def show(kind: str, *found: Any) -> None:
        print(json.dumps([kind, *found]), flush=True)

    pause = threading.Event()
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
    modem = rospy.Publisher("/apad1/acoustic_payload", AcousticModemPayload, queue_size=10)
    rospy.Subscriber(
        "/apad1/acoustic_request",
        AcousticModemRequest,
        lambda it: show("request", it.id, it.req_type, bytes(it.msg).hex()),
    )
    show("ready")
    for line in sys.stdin:
        agent_id, medium, data = json.loads(line)
        if medium == "connected":
            while not publishes_to_us(agent_id):
                pause.wait(0.02)
            show("connected")
            continue
        while not (modem if medium == "modem" else said).get_num_connections():
            pause.wait(0.02)
        if medium == "modem":
            modem.publish(AcousticModemPayload(msg=bytes.fromhex(data), sender_id=-1))
        else:
            said.publish(Packet(agent=agent_id, medium=medium, data=bytes.fromhex(data)))


if __name__ == "__main__":
    main()
