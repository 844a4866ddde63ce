"""Flies a scenario and prints the mission's decisions as JSON.

Use: legacy_flight.py SCENARIO asap|ros [SPEED|max] [PATIENCE_S]

With `ros`, ROS_MASTER_URI names a master on which the simulated aPad's node runs.
"""

from __future__ import annotations

import json
import sys
import time
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from agents.coordinator import Coordinator
from agents.hosting.in_process import InProcessHost
from apad_bridge.assembly import fleet_parts, parts
from apad_bridge.assembly.flight_config import flight_config
from apad_bridge.assembly.safety import safety_of
from apad_bridge.assembly.stacks import part_of, stack_of
from apad_bridge.events.event import Event
from apad_bridge.ros.gateway.gateway import open_gateway
from apad_bridge.ros.links.legacy_link import OpenLink
from apad_bridge.ros.system.ros_pace import OwnMasterClock
from apad_bridge.scenario import loader
from apad_bridge.scenario.schema import Scenario
from apad_bridge.scenario.starts import starts_of
from apad_bridge.supervisor.clock import AsFastAsPossible
from apad_bridge.supervisor.context import FlightContext
from apad_bridge.vehicle.errors import VehicleNotReady
from apad_bridge.vehicle.link import VehicleLink
from apad_bridge.world.apad.in_process import InProcessVehicle
from apad_bridge.world.fleet import FlightFleet, WithoutWater
from apad_bridge.world.world import World


class Decisions:
    """A recorder that keeps the mission's decisions and acts, with their mission time in seconds."""

    kinds = ("plan", "primitive", "dock", "released", "given_up")

    def __init__(self) -> None:
        self.kept: list[Any] = []

    def event(self, at_ms: int, event: Event) -> None:
        if event.kind in self.kinds:
            wanted = (
                "purpose",
                "agent",
                "dock",
                "closed",
                "name",
                "phase",
                "what",
                "reason",
                "solution",
                "full",
            )
            data = event.data
            self.kept.append([at_ms / 1000, event.kind, {key: data[key] for key in wanted if key in data}])

    def truths(self, truths: Any) -> None:
        pass

    def tick(self, *_: Any) -> None:
        pass


def fly(scenario: Scenario, over_ros: bool, speed: float | None, patience_s: float) -> dict[str, Any]:
    decisions = Decisions()
    initial_states = fleet_parts.initial_states(scenario, starts_of(scenario))
    host = InProcessHost(fleet_parts.fleet_config(flight_config(scenario)), initial_states)
    coordinator = Coordinator(host, dict.fromkeys(initial_states, 0), scenario.time_scale)
    fleet = FlightFleet(coordinator, host, WithoutWater(coordinator, host))
    with ExitStack() as stack:
        vehicle: VehicleLink
        if over_ros:
            gateway = open_gateway(initial_states, scenario.time_scale, node_name="musselbed")
            stack.callback(gateway.close)
            safety = safety_of(scenario)
            open_link: OpenLink = part_of(
                stack_of(scenario.apad.generation).generation, "ros.link", "open_link"
            )
            link = open_link(scenario, safety.gate, lambda now_ms: {}, {}, 0, our_clock=True).link
            vehicle = link
            stack.callback(link.close)
            link.wait_until_ready(5 * patience_s)
            pace = OwnMasterClock(speed, link, patience_s=patience_s)
            context = FlightContext(
                vehicle=link,
                pace=pace,
                world=World(fleet),
                safety=safety,
                watchers=lambda flying: (gateway.watcher(flying), ticked),
            )
        else:
            vehicle = InProcessVehicle(parts.simulated_apad(scenario))
            context = FlightContext(vehicle=vehicle, pace=AsFastAsPossible(), world=World(fleet))
        flight = parts.flight(flight_config(scenario), context, decisions)
        supervisor = flight.supervisor
        begun_s = time.monotonic()
        ended_by = flight.run()
        return {
            "ended_by": str(ended_by),
            "decisions": decisions.kept,
            "cost_m": supervisor.mission.state.cost_m,
            "planned_m": supervisor.mission.state.planned_m,
            "services": supervisor.mission.state.services,
            "flight_s": time.monotonic() - begun_s,
            "dropped": dict(flight.dropped + supervisor.dropped + supervisor.port.dropped),
            "vehicle_dropped": dict(getattr(vehicle, "dropped", {})),
        }


def ticked(now_ms: int) -> None:
    """Prints on standard error that the flight is under way, for tests that disturb it."""
    if now_ms == 10_000:
        print("flying", file=sys.stderr, flush=True)


def main() -> None:
    scenario = loader.load(Path(sys.argv[1]))
    speed = None if sys.argv[3:4] in ([], ["max"]) else float(sys.argv[3])
    patience_s = float(sys.argv[4]) if len(sys.argv) > 4 else 10.0
    try:
        result = fly(scenario, sys.argv[2] == "ros", speed, patience_s)
    except (TimeoutError, VehicleNotReady) as error:
        result = {"failed": str(error)}
    print(json.dumps(result))


if __name__ == "__main__":
    main()
