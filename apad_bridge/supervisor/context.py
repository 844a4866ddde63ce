"""What is around a supervisor that flies, in one value: whoever runs a flight puts it together, the flight lives in it.

What a supervisor has learned, and the next one goes on with.
"""

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
from apad_bridge.supervisor.packet_relay import PacketRelay, TellServedElsewhere
from apad_bridge.supervisor.roster import Roster
from apad_bridge.vehicle.link import VehicleLink


@dataclass(frozen=True, slots=True)
class LearnedState:
    beliefs: FleetBeliefs
    ranging: RangingService | None
    """None without water, or without a modem in it."""


Watcher = Callable[[int], None]
"""Called after each tick with the mission time: progress, publishing."""


class Announce(Protocol):
    def __call__(self, at_ms: int, kind: str, **data: Any) -> None: ...


@dataclass(frozen=True, slots=True)
class FlightContext:
    """What a supervisor flies with: the vehicle, what lets time pass, the fleet (or none), and who watches each tick."""

    vehicle: VehicleLink
    pace: Pace
    fleet: Fleet | None
    watchers: Callable[[Supervisor], tuple[Watcher, ...]] = lambda supervisor: ()
    """Made once, for the supervisor that flies."""
    announce: Announce | None = None
    """Told every event of the flight, as the journal is."""
    relay: PacketRelay | None = None
    """Where the other half of the bench is another process: a fleet's packets go there, or a supervisor's."""
    held: tuple[int, ...] = ()
    """aMussels that docks hold already."""
    docks_by_eye: bool = False
    """Whether the vehicle has a visual servoing that a camera can show something to."""
    dropped: Callable[[], Counter[str]] = Counter
    """What was heard around here and came to nothing, by reason."""
    noticed: Callable[[int], list[tuple[str, dict[str, Any]]]] = lambda now_ms: []
    """Events of the surroundings (kind, data) that were not told yet: a master that is gone, a vehicle that is silent."""
    serial_lines: SerialLines | None = None
    """Serial lines, which are looked at between ticks too."""
    roster: Roster | None = None
    """By which it may change who of the fleet is simulated."""
    keeps_samples: bool = True
    """False for a fleet whose mission is at the other end of an ether: its samples are uploaded there."""
    tell_served_elsewhere: TellServedElsewhere | None = None
    """Where one of several aPads may serve another's aMussels."""
    breakdown: Breakdown | None = None
    """What makes one of several aPads stand down; None for one that is alone, or whose work nobody takes over."""
    allocation: Allocation | None = None
    """Whom it serves, over the beliefs that the flight is given; None: its own fleet."""
