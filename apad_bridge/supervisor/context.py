"""The context of a flight in one value, which the caller of the flight builds."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

from agents.time_scale import MissionMs
from apad_bridge.acoustics.serial.lines import SerialLines
from apad_bridge.events.event import Event
from apad_bridge.events.mission_events import MissionEnd
from apad_bridge.mission.policy.plan_checks import Planning, without_progress
from apad_bridge.mission.stand_down_rule import NeverStandsDown, StandDownRule
from apad_bridge.supervisor.clock import Pace
from apad_bridge.supervisor.forecast import Forecast
from apad_bridge.supervisor.packet_relay import PacketRelay, no_relay
from apad_bridge.supervisor.supervisor import Supervisor
from apad_bridge.vehicle.capabilities import Capabilities
from apad_bridge.vehicle.guards.gate import Safety, plain_safety
from apad_bridge.vehicle.vehicle_link import VehicleLink
from apad_bridge.world.world import World

Watcher = Callable[[MissionMs], None]
"""Called after each tick with the mission time: progress, publishing."""
Announce = Callable[[MissionMs, Event], None]


@dataclass(frozen=True, slots=True, kw_only=True)
class FlightContext:
    """The parts that a supervisor flies with. The defaults are parts that do nothing, for a single aPad without ROS."""

    vehicle: VehicleLink
    pace: Pace
    world: World
    safety: Safety = field(default_factory=plain_safety)
    """Judges each order before it goes out to the vehicle, and watches the vehicle between orders."""
    watchers: Callable[[Supervisor], tuple[Watcher, ...]] = lambda supervisor: ()
    """Makes the watchers, once, for the flight's supervisor."""
    announce: Announce = lambda at_ms, event: None
    """Receives every event of the flight, as the journal does."""
    flush_records: Callable[[], None] = lambda: None
    """Writes what was recorded so far, so that it outlives this process."""
    relay: PacketRelay = field(default_factory=no_relay)
    """Relays packets, and the contacts of docks, between this flight's aMussels and supervisor and those elsewhere."""
    capabilities: Capabilities | None = None
    """The vehicle's; None: those of the simulated aPad with the scenario's docks."""
    dropped: Callable[[], Counter[str]] = Counter
    """The counts of messages that the context dropped, by reason."""
    show_forecast: Callable[[int, Callable[[], Forecast]], None] = lambda now_ms, forecast: None
    """Receives the forecast of each tick."""
    planning: Planning = without_progress
    """Entered while a strategy plans: mission time waits for it."""
    take_events: Callable[[int], Sequence[Event]] = lambda now_ms: []
    """Returns the context's new events: a master that is gone, a vehicle that is silent."""
    serial_lines: SerialLines = field(default_factory=SerialLines)
    """Serial lines, which are polled between ticks too."""
    keeps_samples: bool = True
    """False for a fleet whose mission is at the other end of a relay: its samples are uploaded there."""
    ended_by_graph: Callable[[Callable[[MissionEnd], None]], None] = lambda stop: None
    """Receives the function that stops the flight; calls it, in any thread, when another tells our node to end."""
    stands_down: StandDownRule = field(default_factory=NeverStandsDown)
    """The conditions in which one of several aPads stands down."""
