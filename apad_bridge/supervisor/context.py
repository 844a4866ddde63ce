"""The context of a flight in one value, which the caller of the flight builds; and the state that a supervisor learns."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

from apad_bridge.acoustics.ranging import RangingService
from apad_bridge.acoustics.serial.lines import SerialLines
from apad_bridge.beliefs.fleet import FleetBeliefs
from apad_bridge.mission.allocation import Allocation
from apad_bridge.mission.breakdown import Breakdown
from apad_bridge.supervisor.clock import Pace
from apad_bridge.supervisor.core import Supervisor
from apad_bridge.supervisor.fleet import Fleet
from apad_bridge.supervisor.packet_relay import PacketRelay
from apad_bridge.supervisor.roster import Roster
from apad_bridge.vehicle.capabilities import Capabilities
from apad_bridge.vehicle.link import VehicleLink


@dataclass(frozen=True, slots=True)
class LearnedState:
    """The state that a supervisor learns, and that the next supervisor of the run continues with."""

    beliefs: FleetBeliefs
    ranging: RangingService | None
    """None without water, or without a modem in it."""


Watcher = Callable[[int], None]
"""Called after each tick with the mission time: progress, publishing."""


class Announce(Protocol):
    def __call__(self, at_ms: int, kind: str, **data: Any) -> None: ...


@dataclass(frozen=True, slots=True)
class FlightContext:
    """The parts that a supervisor flies with: the vehicle, the pace of time, the fleet (or none), the tick's watchers."""

    vehicle: VehicleLink
    pace: Pace
    fleet: Fleet | None
    watchers: Callable[[Supervisor], tuple[Watcher, ...]] = lambda supervisor: ()
    """Makes the watchers, once, for the flight's supervisor."""
    announce: Announce | None = None
    """Receives every event of the flight, as the journal does."""
    relay: PacketRelay | None = None
    """Relays packets, and the contacts of docks, between this flight's aMussels and supervisor and those elsewhere."""
    held: tuple[int, ...] = ()
    """The aMussels that docks hold already."""
    capabilities: Capabilities | None = None
    """The vehicle's; None: those of the simulated aPad with the scenario's docks."""
    dropped: Callable[[], Counter[str]] = Counter
    """The counts of messages that the context dropped, by reason."""
    take_events: Callable[[int], list[tuple[str, dict[str, Any]]]] = lambda now_ms: []
    """Returns the context's new events (kind, data): a master that is gone, a vehicle that is silent."""
    serial_lines: SerialLines | None = None
    """Serial lines, which are polled between ticks too."""
    roster: Roster | None = None
    """Changes which aMussels of the fleet are simulated."""
    keeps_samples: bool = True
    """False for a fleet whose mission is at the other end of a relay: its samples are uploaded there."""
    breakdown: Breakdown | None = None
    """The conditions in which one of several aPads stands down; None for a single aPad, or when no aPad takes over."""
    allocation: Allocation | None = None
    """The aMussels that the aPad serves, over the beliefs that the flight is given; None: its own fleet."""
