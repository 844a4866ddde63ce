"""Opens a gateway, prints `open` and the time that took, or the refusal; stays until its standard input ends.

Use: open_a_gateway.py NODE FIRST_ID COUNT; ROS_MASTER_URI names the master.
"""

from __future__ import annotations

import sys
import time

from agents.time_scale import TimeScale
from apad_bridge.beliefs.hold_last import HoldLast
from apad_bridge.ros.gateway.fleet_guard import SecondFleet
from apad_bridge.ros.gateway.gateway import GatewayFailed, open_gateway
from firmware_model.packets import StatusPacket
from firmware_model.states import State


class Supervisor:
    """The part of a supervisor that the gateway publishes: the belief of its first aMussel."""

    pose = battery = None
    primitive = "none"

    def __init__(self, first_id: int) -> None:
        self.beliefs = HoldLast([first_id])
        packet = StatusPacket(
            agent_id=first_id,
            sequence=0,
            agent_ms=0,
            state=State.ACTIVE,
            north_m=1.5,
            east_m=-2.5,
            depth_m=3.0,
            primary=0.75,
            secondary=1.0,
        )
        assert self.beliefs.hear(packet, 0) is None


def main() -> None:
    node, first_id, count = sys.argv[1], int(sys.argv[2]), int(sys.argv[3])
    begun_s = time.monotonic()
    try:
        gateway = open_gateway(range(first_id, first_id + count), TimeScale(30), node_name=node)
    except (SecondFleet, GatewayFailed) as refused:
        print(refused, flush=True)
        return
    gateway.watcher(Supervisor(first_id))(1_000)
    print(f"open {time.monotonic() - begun_s:.2f} s", flush=True)
    sys.stdin.read()
    gateway.close()


if __name__ == "__main__":
    main()
