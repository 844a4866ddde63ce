"""What an aPad can know of one aMussel: what it heard, what it should have heard, and what it did itself.

StampChecker are mission milliseconds. There is no measurement of truth.
"""

from __future__ import annotations

from dataclasses import dataclass

from firmware_model.packets import StatusPacket
from firmware_model.states import State


@dataclass(frozen=True, slots=True)
class Heard:
    """A status packet, decoded."""

    at_ms: int
    packet: StatusPacket


@dataclass(frozen=True, slots=True)
class HeardShort:
    """A short status, decoded: it says neither place nor time, and was sent when it was heard."""

    at_ms: int
    state: State
    primary: float
    secondary: float


@dataclass(frozen=True, slots=True)
class TimeslotSilent:
    """A slot in which a packet was due ended without one."""

    at_ms: int


@dataclass(frozen=True, slots=True)
class Permitted:
    """The aPad sent the permission to surface."""

    at_ms: int


@dataclass(frozen=True, slots=True)
class Docked:
    """The aPad closed a dock around it, and stands where it is."""

    at_ms: int


@dataclass(frozen=True, slots=True)
class Released:
    """The aPad opened the dock that held it, at this place."""

    at_ms: int
    north_m: float
    east_m: float


@dataclass(frozen=True, slots=True)
class Fixed:
    """Its place was measured: by GPS at the surface, or by an acoustic fix. `variance_m2` is that of either axis."""

    at_ms: int
    north_m: float
    east_m: float
    variance_m2: float


@dataclass(frozen=True, slots=True)
class Ranged:
    """Its distance from a place was measured, along the bottom."""

    at_ms: int
    range_m: float
    from_north_m: float
    from_east_m: float
    variance_m2: float


@dataclass(frozen=True, slots=True)
class ClockSet:
    """Its clock was set, and shows this now: a reset, or somebody told it the time."""

    at_ms: int
    agent_ms: int


Measurement = Heard | HeardShort | TimeslotSilent | Permitted | Docked | Released | Fixed | Ranged | ClockSet


class Rejected(ValueError):
    """A measurement that is not believed; its text is the reason, and the belief stays as it was."""
