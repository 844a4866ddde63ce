"""What the board does to the world, in the imperative. `at_ms` is agent time."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

from firmware_model.power.feed import ActiveBattery
from firmware_model.power.rails import Rail
from firmware_model.states import State, Trigger


class Buoyancy(IntEnum):
    """What the buoyancy motors were last run to."""

    SINK = 0
    FLOAT = 1
    HOVER = 2


@dataclass(frozen=True, slots=True)
class StateChanged:
    at_ms: int
    old: State
    trigger: Trigger
    new: State


@dataclass(frozen=True, slots=True)
class RunBuoyancy:
    """`depth_mm` is where to hover; None: at the depth where it is."""

    at_ms: int
    to: Buoyancy
    depth_mm: int | None = None


@dataclass(frozen=True, slots=True)
class SetRail:
    at_ms: int
    rail: Rail
    on: bool


@dataclass(frozen=True, slots=True)
class FeedFrom:
    """The board lives on another battery from now on."""

    at_ms: int
    feed: ActiveBattery


@dataclass(frozen=True, slots=True)
class LogSample:
    """All sensors have been read: one sample of what the mission is for."""

    at_ms: int


@dataclass(frozen=True, slots=True)
class DropLog:
    """All records of the log below this sequence are kept elsewhere."""

    at_ms: int
    next_sequence: int


@dataclass(frozen=True, slots=True)
class SendLog:
    """Send what waits in the log, by Wi-Fi."""

    at_ms: int


@dataclass(frozen=True, slots=True)
class SendStatus:
    """Send a status by the modem or by Wi-Fi; who hosts the board knows its place and makes the packet."""

    at_ms: int
    by: Rail


@dataclass(frozen=True, slots=True)
class SendAnswer:
    """Send a short status by the modem: somebody asked for it."""

    at_ms: int


@dataclass(frozen=True, slots=True)
class Dropped:
    """A stimulus that the board could not use; counted by whoever hosts it, never raised."""

    at_ms: int
    reason: str


Action = (
    StateChanged
    | RunBuoyancy
    | SetRail
    | FeedFrom
    | LogSample
    | DropLog
    | SendLog
    | SendStatus
    | SendAnswer
    | Dropped
)

MOTORS = {
    State.SURFACING: Buoyancy.FLOAT,
    State.SINKING: Buoyancy.SINK,
    State.HOVERING: Buoyancy.HOVER,
}
"""Where the motors are run to on entering a state."""
REPORTS = {
    State.TRANSMITTING: Rail.MODEM_TRANSMITTING,
    State.CALLING: Rail.MODEM_TRANSMITTING,
    State.REPORTING: Rail.WIFI,
}
"""By what a status is sent on entering a state."""
