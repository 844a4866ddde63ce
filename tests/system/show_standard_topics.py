"""Shows a fleet of two on ROS's standard messages, a tick every 100 ms, until its standard input ends.

Use: show_standard_topics.py; prints `showing`. aMussel 1 wants charging, aMussel 2 was never heard, the aPad heads east.
"""

from __future__ import annotations

import select
import sys
from types import SimpleNamespace

from apad_bridge.beliefs.hold_last import HoldLast
from apad_bridge.geography import LocalFrame
from apad_bridge.mission.state import MissionState
from apad_bridge.planning.solution import Solution, Step, StepKind
from apad_bridge.ros.fleet_diagnostics import Limits
from apad_bridge.ros.gateway import open_gateway
from apad_bridge.ros.standard_topics import StandardTopics
from apad_bridge.vehicle import BatteryReported, PoseReported
from firmware_model.packets import StatusPacket
from firmware_model.states import State


def supervisor() -> SimpleNamespace:
    """As much of one as the topics show."""
    beliefs = HoldLast([1, 2])
    packet = StatusPacket(
        agent_id=1,
        sequence=0,
        agent_ms=0,
        state=State.ACTIVE,
        north_m=10.0,
        east_m=20.0,
        depth_m=3.0,
        primary=0.75,
        secondary=1.0,
    )
    assert beliefs.hear(packet, 1000) is None
    return SimpleNamespace(
        beliefs=beliefs,
        pose=PoseReported(1000, 1.0, 2.0, 1.5707963267948966),
        battery=BatteryReported(1000, 15.0, 0.5),
        primitive="go to point",
        port=SimpleNamespace(first_failure=None),
        dropped={},
        mission=SimpleNamespace(
            state=MissionState(plan=Solution((Step(StepKind.COLLECT, 1, 0),))), slots=(None, None, None, None)
        ),
    )


def main() -> None:
    gateway = open_gateway([], 30, node_name="shower")
    frame = LocalFrame(43.9330937, 15.4443468)
    standard = StandardTopics((1, 2), "apad1", frame, Limits(silence_s=120.0, pool_threshold=0.8), ball_m=0.5)
    watch = standard.watcher(supervisor())  # type: ignore[arg-type]
    print("showing", flush=True)
    now_ms = 1000
    while not select.select([sys.stdin], [], [], 0.1)[0]:
        watch(now_ms)
        now_ms += 1000
    gateway.close()


if __name__ == "__main__":
    main()
