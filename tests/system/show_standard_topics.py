"""Publishes a fleet of three in ROS's standard messages, a tick every 100 ms, until its standard input ends.

Use: show_standard_topics.py; prints `showing`. aMussel 1 wants charging, aMussel 2 was never heard, the belief of aMussel 3
has deviations; the aPad heads east.
"""

from __future__ import annotations

import select
import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from agents.time_scale import TimeScale
from apad_bridge.beliefs.belief import Belief, ClockBelief, Source
from apad_bridge.beliefs.hold_last import HoldLast
from apad_bridge.beliefs.modes import Mode
from apad_bridge.events.mission_events import MissionState
from apad_bridge.mission.sources import Allocation
from apad_bridge.planning.solution import Step, StepKind
from apad_bridge.ros.gateway.gateway import open_gateway
from apad_bridge.ros.gateway.standard_topics import StandardTopics
from apad_bridge.scenario.loader import load
from apad_bridge.supervisor.forecast import Forecast
from apad_bridge.vehicle.commands import BatteryReported, PoseReported
from firmware_model.packets import StatusPacket
from firmware_model.states import State


def supervisor() -> SimpleNamespace:
    """The part of a supervisor that the topics show."""
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
    sure = Belief(
        3,
        1000,
        State.SLEEPING,
        0.5,
        1.0,
        10.0,
        20.0,
        0,
        (0.0001, 0.0, 0.0),
        (4.0, 0.5, 9.0),
        tuple(float(mode is Mode.ASLEEP) for mode in Mode),
        ClockBelief(250.0, 0.0, 90_000.0, 0.0, 0.0),
        Source.PACKET | Source.SILENCE,
        2,
    )
    known = [*beliefs.all(), sure]
    believed: Any = SimpleNamespace(all=lambda: known, get={it.agent_id: it for it in known}.get)
    return SimpleNamespace(
        beliefs=believed,
        allocation=Allocation(believed, ()),
        pose=PoseReported(1000, 1.0, 2.0, 1.5707963267948966),
        battery=BatteryReported(1000, 15.0, 0.5),
        primitive="go to point",
        port=SimpleNamespace(first_failure=None),
        dropped={},
        mission=SimpleNamespace(
            state=MissionState(plan=(Step(StepKind.COLLECT, 1, 0),)),
            docks=(None, None, None, None),
            unheard="",
        ),
    )


def main() -> None:
    gateway = open_gateway([], TimeScale(30), node_name="shower")
    pool = load(Path(__file__).parents[1] / "shared/scenarios/pool.yaml")
    standard = StandardTopics(
        replace(pool, mission=replace(pool.mission, silence_timeout_s=3600.0)), (1, 2, 3)
    )
    shown: Any = supervisor()
    watches = [standard.watcher(shown), gateway.watcher(shown)]
    print("showing", flush=True)
    now_ms = 1000
    while not select.select([sys.stdin], [], [], 0.1)[0]:
        for watch in watches:
            watch(now_ms)
        gateway.show_forecast(now_ms, Forecast(200.0, None, 1860.0, 0.62))
        now_ms += 1000
    gateway.close()


if __name__ == "__main__":
    main()
