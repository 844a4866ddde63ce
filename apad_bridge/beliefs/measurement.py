"""Everything that an aPad can know of one aMussel: packets received or missed, its own actions, and position fixes.

Stamps are mission milliseconds. There is no measurement of truth.
"""

from __future__ import annotations

from dataclasses import dataclass

from agents.time_scale import AgentMs, MissionMs
from firmware_model.packets import StatusPacket
from firmware_model.states import State
from firmware_model.value import value


@value
class Heard:
    """A decoded status packet."""

    at_ms: MissionMs
    packet: StatusPacket


@dataclass(frozen=True, slots=True)
class HeardShort:
    """A decoded short status: it contains neither place nor time, and counts as sent when it was received."""

    at_ms: MissionMs
    state: State
    primary: float
    secondary: float


@dataclass(frozen=True, slots=True)
class TimeslotSilent:
    """A timeslot in which a packet was due ended without one."""

    at_ms: MissionMs


@dataclass(frozen=True, slots=True)
class Permitted:
    """The aPad sent the permission to surface."""

    at_ms: MissionMs


@dataclass(frozen=True, slots=True)
class Docked:
    """The aPad closed a dock around the aMussel, and stands at the same place."""

    at_ms: MissionMs


@dataclass(frozen=True, slots=True)
class Released:
    """The aPad opened the dock that held the aMussel, at this place."""

    at_ms: MissionMs
    north_m: float
    east_m: float


@dataclass(frozen=True, slots=True)
class Fixed:
    """A measured place, from GPS at the surface or from an acoustic fix. `variance_m2` is that of either axis."""

    at_ms: MissionMs
    north_m: float
    east_m: float
    variance_m2: float


@dataclass(frozen=True, slots=True)
class Ranged:
    """A measured distance from a place, along the bottom."""

    at_ms: MissionMs
    range_m: float
    from_north_m: float
    from_east_m: float
    variance_m2: float


@dataclass(frozen=True, slots=True)
class ClockSet:
    """The aMussel's clock was set and shows `agent_ms` now: after a reset, or by somebody's beacon."""

    at_ms: MissionMs
    agent_ms: AgentMs


Measurement = Heard | HeardShort | TimeslotSilent | Permitted | Docked | Released | Fixed | Ranged | ClockSet


class Rejected(ValueError):
    """A measurement is not believed; the text is the reason, and the belief stays as it was."""
