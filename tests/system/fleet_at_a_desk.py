"""Flies a fleet of four with services and claims, at twenty times real time, and prints its events as JSON.

Use: fleet_at_a_desk.py NODE FIRST_ID [CLAIMANT]; ROS_MASTER_URI names the master. The first line is `flying`, or the reason
why it does not fly. With a CLAIMANT it comes back after a crash, before which that node claimed its third aMussel as real;
then its lines about claims come first.
"""

from __future__ import annotations

import json
import signal
import sys
from pathlib import Path
from typing import Any

from agents.coordinator import Coordinator
from agents.hosting.faulty_host import FaultyHost
from agents.hosting.in_process import InProcessHost
from apad_bridge.assembly import fleet_parts, flight_parts
from apad_bridge.assembly.flight_config import flight_config
from apad_bridge.events.event import Event
from apad_bridge.events.fleet_events import Presence
from apad_bridge.events.mission_events import MissionEnd
from apad_bridge.events.run_events import EndReason
from apad_bridge.ros.gateway.battery_alerts import BatteryAlerts
from apad_bridge.ros.gateway.claims import ClaimBoard
from apad_bridge.ros.gateway.fleet_guard import SecondFleet
from apad_bridge.ros.gateway.fleet_services import FleetServices
from apad_bridge.ros.gateway.gateway import open_gateway
from apad_bridge.ros.links.packet_topics import PacketTopics
from apad_bridge.scenario.loader import from_data, load, resolve
from apad_bridge.scenario.schema import Scenario
from apad_bridge.scenario.starts import starts_of
from apad_bridge.supervisor.clock import WallClock
from apad_bridge.supervisor.context import FlightContext
from apad_bridge.supervisor.packet_relay import PacketRelay, RelayOutcome, whole_flight
from apad_bridge.world.apad.in_process import InProcessVehicle
from apad_bridge.world.fault_injection import FaultInjection
from apad_bridge.world.roster import PresenceChange, Presences, Roster
from apad_bridge.world.simulated_fleet import FlightFleet, WithoutWater
from apad_bridge.world.world import World

SPEED = 20.0
SHOWN = ("presence", "fault", "end")


class PrintingRecorder:
    """A recorder that prints some events, and keeps nothing."""

    def event(self, at_ms: int, event: Event) -> None:
        if event.kind in SHOWN:
            print(json.dumps({"kind": event.kind, **event.data}), flush=True)

    def truths(self, truths: Any) -> None:
        pass

    def samples(self, *_: Any) -> None:
        pass

    def tick(self, *_: Any) -> None:
        pass


def scenario(first_id: int) -> Scenario:
    data = resolve(load(Path(__file__).parents[1] / "shared/scenarios/pool.yaml"))
    data.update(name="desk", duration_s=36_000)
    data["fleet"].update(count=4, first_id=first_id, start={"charge": [0.95, 0.95]})
    # So slowly that nobody falls below the mission's threshold by itself: the alerts are the test's own.
    data["board"]["discharge_per_min"] = 1e-7
    return from_data(data, "desk")


def main() -> None:
    node, first_id, *claimant = sys.argv[1], int(sys.argv[2]), *sys.argv[3:]
    flown = scenario(first_id)
    initial_states = fleet_parts.initial_states(flown, starts_of(flown))
    before = [PresenceChange(0, first_id + 2, Presence.REAL, name) for name in claimant]
    presences = Presences(initial_states, flown.area.depth_m, before)
    gateway = open_gateway([], flown.time_scale, node_name=node)
    claims = ClaimBoard(f"/{node}", lambda: presences.simulated)
    try:
        if before:
            print(*claims.resume(presences), sep="\n", flush=True)
        else:
            claims.refuse_overlap(initial_states)
    except SecondFleet as refused:
        print(refused, flush=True)
        gateway.close()
        return
    alerts = BatteryAlerts(flown, initial_states, "", lambda: presences.simulated)
    services = FleetServices(presences, claims)
    division = whole_flight(lambda: presences.simulated)
    topics = PacketTopics(initial_states, division.peers)
    relay = PacketRelay(division, [topics.take], {RelayOutcome.PUBLISH: topics.publish})
    host = InProcessHost(fleet_parts.fleet_config(flight_config(flown)), initial_states)
    coordinator = Coordinator(host, dict.fromkeys(initial_states, 0), flown.time_scale)
    faults = FaultInjection(FaultyHost(host, flown.seed), flown.time_scale)
    flight = flight_parts.flight(
        flight_config(flown),
        FlightContext(
            vehicle=InProcessVehicle(flight_parts.simulated_apad(flown)),
            pace=WallClock(SPEED),
            world=World(
                FlightFleet(coordinator, host, WithoutWater(coordinator, host)),
                faults,
                roster=Roster(presences, services, coordinator, faults),
            ),
            watchers=lambda flying: (gateway.watcher(flying), alerts.watcher(flying)),
            relay=relay,
        ),
        PrintingRecorder(),
    )
    signal.signal(signal.SIGTERM, lambda *_: flight.stop(MissionEnd(EndReason.OPERATOR, "told to end")))
    print("flying", flush=True)
    flight.run()
    services.close()
    topics.close()
    gateway.close()


if __name__ == "__main__":
    main()
