"""Flies a scenario and prints what was decided, as JSON. Use: generation_a_flight.py SCENARIO asap|ros [SPEED|max]

With `ros`, ROS_MASTER_URI names a master on which the simulated aPad's node runs.
"""

from __future__ import annotations

import json
import sys
import time
from pathlib import Path
from typing import Any

from agents.coordinator import Coordinator
from agents.one_process import OneProcess
from apad_bridge import building
from apad_bridge.flight import Fleet, Flight
from apad_bridge.pace import AsFastAsPossible
from apad_bridge.scenario import loader
from apad_bridge.scenario.starts import starts_of
from apad_bridge.simulated_apad.apad import SimulatedAPad
from apad_bridge.vehicle_link import InProcessVehicle


class Decisions:
    """A recorder that keeps what the mission decided and did, with its mission time in seconds."""

    kinds = ("plan", "primitive", "dock", "released", "given_up")

    def __init__(self) -> None:
        self.kept: list[Any] = []

    def event(self, at_ms: int, kind: str, **data: Any) -> None:
        if kind in self.kinds:
            wanted = (
                "purpose",
                "agent",
                "slot",
                "closed",
                "name",
                "phase",
                "what",
                "reason",
                "solution",
                "full",
            )
            self.kept.append([at_ms / 1000, kind, {key: data[key] for key in wanted if key in data}])

    def truths(self, truths: Any) -> None:
        pass

    def tick(self, *_: Any) -> None:
        pass


def main() -> None:
    scenario = loader.load(Path(sys.argv[1]))
    decisions = Decisions()
    births = building.births(scenario, starts_of(scenario))
    host = OneProcess(building.fleet_config(scenario), births)
    fleet = Fleet(Coordinator(host, dict.fromkeys(births, 0), scenario.theta), host)
    supervisor = building.supervisor(scenario)
    vehicle: Any = InProcessVehicle(SimulatedAPad(scenario.apad))
    pace: Any = AsFastAsPossible()
    watchers: tuple[Any, ...] = ()
    gateway = None
    opened_s = time.monotonic()
    if sys.argv[2] == "ros":
        from apad_bridge.ros.gateway import open_gateway
        from apad_bridge.ros.generation_a import GenerationALink
        from apad_bridge.ros.ros_pace import OwnMasterClock

        speed = None if sys.argv[3] == "max" else float(sys.argv[3])
        battery = scenario.apad.battery
        gateway = open_gateway(births, scenario.theta, node_name="musselbed")
        vehicle = GenerationALink(
            scenario.apad.name, births, (battery.empty_v, battery.full_v), our_clock=True
        )
        vehicle.wait_until_ready(10.0)
        pace = OwnMasterClock(speed, vehicle)
        watchers = (gateway.watcher(supervisor),)
    ready_s = time.monotonic()
    flight = Flight(supervisor, vehicle, pace, decisions, fleet, watchers)
    ended_by = flight.run()
    state = supervisor.mission.state
    battery_now = supervisor.battery
    summary = {
        "ended_by": ended_by,
        "decisions": decisions.kept,
        "cost_m": state.cost_m,
        "services": state.services,
        "apad_fraction": None if battery_now is None else battery_now.fraction,
        "open_s": ready_s - opened_s,
        "flight_s": time.monotonic() - ready_s,
        "dropped": dict(flight.dropped + supervisor.dropped + supervisor.port.dropped),
        "vehicle_dropped": dict(getattr(vehicle, "dropped", {})),
    }
    print(json.dumps(summary))
    vehicle.close()
    if gateway is not None:
        gateway.close()


if __name__ == "__main__":
    main()
