"""A gateway with N aMussels that ticks once a second, as a supervisor's does. For `benchmarks/run gateway`.

Use: gateway.py AGENTS; prints `open SECONDS XMLRPC_URI`. A line "tick N" on stdin makes N ticks and prints `ticked`; the
end of stdin closes the gateway and prints a line of JSON: counts of published messages, and of those that readers missed.
The north of each aMussel is the monotonic clock's seconds at the tick, from 0 to `LAP_S` and again from 0.
"""

from __future__ import annotations

import json
import sys
import time

import rospy

from agents.time_scale import MissionMs, TimeScale
from apad_bridge.beliefs.hold_last import HoldLast
from apad_bridge.ros.gateway.gateway import Gateway, open_gateway
from firmware_model.packets import StatusPacket
from firmware_model.states import State

THETA = 30
NODE = "musselbed_1"
LAP_S = 1000.0
"""A supervisor drops a place that is as far away as a machine's clock says after half a day."""


class Supervisor:
    """The part of a supervisor that a gateway publishes."""

    pose = battery = None
    primitive = "none"

    def __init__(self, agents: int) -> None:
        self.agents = agents
        self.beliefs = HoldLast(range(1, agents + 1))

    def hear_all(self, now_ms: int, now_s: float) -> None:
        for agent_id in range(1, self.agents + 1):
            self.beliefs.hear(
                StatusPacket(
                    agent_id=agent_id,
                    sequence=now_ms // 1000,
                    agent_ms=THETA * now_ms,
                    state=State.ACTIVE,
                    north_m=now_s,
                    east_m=0.0,
                    depth_m=3.0,
                    primary=0.5,
                    secondary=1.0,
                ),
                MissionMs(now_ms),
            )


def tick(gateway: Gateway, supervisor: Supervisor, first: int, count: int) -> None:
    watch = gateway.watcher(supervisor)  # type: ignore[arg-type]  # the part of one that a gateway reads
    due_s = time.monotonic()
    for number in range(first, first + count):
        time.sleep(max(0.0, due_s - time.monotonic()))
        supervisor.hear_all(1000 * number, time.monotonic() % LAP_S)
        watch(MissionMs(1000 * number))
        due_s += 1.0
    time.sleep(max(0.0, due_s - time.monotonic()))


def main() -> None:
    agents = int(sys.argv[1])
    began_s = time.monotonic()
    gateway = open_gateway(range(1, agents + 1), TimeScale(THETA), node_name=NODE)
    print("open", time.monotonic() - began_s, rospy.get_node_uri(), flush=True)
    supervisor = Supervisor(agents)
    topics, ticks = gateway.agent_topics, 0
    took_s = cpu_s = 0.0
    for line in sys.stdin:
        count = int(line.removeprefix("tick "))
        began_s, cpu_before_s = time.monotonic(), time.process_time()
        tick(gateway, supervisor, ticks + 1, count)
        took_s += time.monotonic() - began_s
        cpu_s += time.process_time() - cpu_before_s
        ticks += count
        print("ticked", flush=True)
    gateway.close()
    report = {
        "published": sum(topics.published.values()),
        "left_out": dict(topics.stalls.left_out),
        "disconnected": dict(topics.stalls.disconnected),
        "longest_stall_s": topics.stalls.longest_s,
        "took_s": took_s,
        "cpu_s": cpu_s,
    }
    print(json.dumps(report), flush=True)


if __name__ == "__main__":
    main()
