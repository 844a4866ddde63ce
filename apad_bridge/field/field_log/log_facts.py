"""Plain facts from the messages of a vehicle, its aMussels and its mission, in the order received.

Times are seconds of the clock that recorded them. Places are local NED metres.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum, auto
from typing import Any

Place = tuple[float, float]
"""North, east."""


class Witness(Enum):
    """The source: the vehicle by its own topics, or a supervisor of ours, which repeats its orders and the answers."""

    VEHICLE = auto()
    SUPERVISOR = auto()


class Work(Enum):
    GO_TO = auto()
    DOCK = auto()
    UNDOCK = auto()


@dataclass(frozen=True, slots=True)
class Posed:
    """The aPad's place; `sent_s` is the message's own stamp, None without one."""

    at_s: float
    witness: Witness
    sent_s: float | None
    place_m: Place


@dataclass(frozen=True, slots=True)
class BatteryReading:
    """The aPad's charge in [0, 1]."""

    at_s: float
    witness: Witness
    fraction: float


@dataclass(frozen=True, slots=True)
class WorkBegan:
    """The aPad goes to a point, docks or undocks. `goal_m` and `agent_id` are None where the order does not name them.

    The same key again, before its end, corrects what was said of the work.
    """

    at_s: float
    witness: Witness
    key: str
    work: Work
    goal_m: Place | None = None
    agent_id: int | None = None


@dataclass(frozen=True, slots=True)
class WorkEnded:
    """`is_done`: it came there, or caught the aMussel; `missed`: it failed by itself, and nobody pre-empted it."""

    at_s: float
    witness: Witness
    key: str
    is_done: bool
    missed: bool = False


@dataclass(frozen=True, slots=True)
class Held:
    """A dock holds this aMussel, or has let it go."""

    at_s: float
    witness: Witness
    agent_id: int
    is_held: bool


@dataclass(frozen=True, slots=True)
class PilotSteers:
    at_s: float
    steers: bool


@dataclass(frozen=True, slots=True)
class PacketLogged:
    """The bytes of an aMussel's packet, by the fleet's codec."""

    at_s: float
    agent_id: int
    medium: str
    data: bytes


@dataclass(frozen=True, slots=True)
class AmusselPlaced:
    """An aMussel's own topic `position`."""

    at_s: float
    agent_id: int
    place_m: Place


@dataclass(frozen=True, slots=True)
class AmusselCharged:
    """An aMussel's own topic `battery_level`: charge in [0, 1]."""

    at_s: float
    agent_id: int
    charge: float


@dataclass(frozen=True, slots=True)
class SoundEnded:
    """A packet of sound at one listener."""

    at_s: float
    range_m: float
    is_received: bool


@dataclass(frozen=True, slots=True)
class BeliefsReport:
    """The beliefs that a supervisor published, row by row, as its own definition has them."""

    at_s: float
    mission_ms: int
    rows: tuple[Any, ...]


@dataclass(frozen=True, slots=True)
class EventReport:
    """An event of a supervisor's mission, as in its journal."""

    at_s: float
    mission_ms: int
    kind: str
    data: Mapping[str, Any]


LoggedFact = (
    Posed
    | BatteryReading
    | WorkBegan
    | WorkEnded
    | Held
    | PilotSteers
    | PacketLogged
    | AmusselPlaced
    | AmusselCharged
    | SoundEnded
    | BeliefsReport
    | EventReport
)
