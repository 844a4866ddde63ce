"""The board's actions on the world, named in the imperative. `at_ms` is agent time."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

from firmware_model.power.active_battery import ActiveBattery
from firmware_model.power.rails import Rail
from firmware_model.states import State, Trigger


class Buoyancy(IntEnum):
    """The target of the last run of the buoyancy motors."""

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
class StateReported:
    """Firmware in a process of its own states its state; nothing but records and reports follows from it."""

    at_ms: int
    old: State
    new: State


@dataclass(frozen=True, slots=True)
class RunBuoyancy:
    """`depth_mm` is the depth to hover at; None for the present depth."""

    at_ms: int
    to: Buoyancy
    depth_mm: int | None = None


@dataclass(frozen=True, slots=True)
class MotorsStalled:
    """The motors did not run: both batteries together hold less than the charge of a run."""

    at_ms: int
    to: Buoyancy


@dataclass(frozen=True, slots=True)
class SetRail:
    at_ms: int
    rail: Rail
    on: bool


@dataclass(frozen=True, slots=True)
class FeedFrom:
    """Another battery feeds the board from now on."""

    at_ms: int
    feed: ActiveBattery


@dataclass(frozen=True, slots=True)
class LogSample:
    """All sensors have been read: write one sample to the log."""

    at_ms: int


@dataclass(frozen=True, slots=True)
class DropLog:
    """All records of the log below this sequence are stored elsewhere."""

    at_ms: int
    next_sequence: int


@dataclass(frozen=True, slots=True)
class SendLog:
    """Send the waiting records of the log by Wi-Fi."""

    at_ms: int


@dataclass(frozen=True, slots=True)
class SendStatus:
    """Send a status by the modem or by Wi-Fi; the board's host knows its place and makes the packet."""

    at_ms: int
    by: Rail


@dataclass(frozen=True, slots=True)
class SendAnswer:
    """Send a short status by the modem, as the answer to a ping."""

    at_ms: int


@dataclass(frozen=True, slots=True)
class SendBytes:
    """Send these bytes by the modem or by Wi-Fi: a packet that the firmware has made itself."""

    at_ms: int
    by: Rail
    data: bytes


@dataclass(frozen=True, slots=True)
class Dropped:
    """The board could not use a stimulus; its host counts this, and nothing is raised."""

    at_ms: int
    reason: str


Action = (
    StateChanged
    | StateReported
    | RunBuoyancy
    | MotorsStalled
    | SetRail
    | FeedFrom
    | LogSample
    | DropLog
    | SendLog
    | SendStatus
    | SendAnswer
    | SendBytes
    | Dropped
)

MOTORS = {
    State.SURFACING: Buoyancy.FLOAT,
    State.SINKING: Buoyancy.SINK,
    State.HOVERING: Buoyancy.HOVER,
}
"""The target of the motor run on entering a state."""
REPORTS = {
    State.TRANSMITTING: Rail.MODEM_TRANSMITTING,
    State.CALLING: Rail.MODEM_TRANSMITTING,
    State.REPORTING: Rail.WIFI,
}
"""The rail by which a status is sent on entering a state."""
