"""Everything that an aPad can know of one aMussel: packets received or missed, its own actions, and position fixes.

A received packet is a measurement as it was decoded. The mission time of a measurement stands beside it. There is no
measurement of truth. A measurement may become a row of plain data, and back.
"""

from __future__ import annotations

from dataclasses import astuple, dataclass
from typing import Any

from agents.time_scale import AgentMs, MissionMs
from firmware_model.packets import ShortStatus, StatusPacket
from firmware_model.states import State


@dataclass(frozen=True, slots=True)
class TimeslotSilent:
    """A timeslot in which a packet was due ended without one."""


@dataclass(frozen=True, slots=True)
class Permitted:
    """The aPad sent the permission to surface."""


@dataclass(frozen=True, slots=True)
class Docked:
    """The aPad closed a dock around the aMussel, and stands at the same place."""


@dataclass(frozen=True, slots=True)
class Released:
    """The aPad opened the dock that held the aMussel, at this place."""

    north_m: float
    east_m: float


@dataclass(frozen=True, slots=True)
class Fixed:
    """A measured place, from GPS at the surface or from an acoustic fix. `variance_m2` is that of either axis."""

    north_m: float
    east_m: float
    variance_m2: float


@dataclass(frozen=True, slots=True)
class Ranged:
    """A measured distance from a place, along the bottom."""

    range_m: float
    from_north_m: float
    from_east_m: float
    variance_m2: float


@dataclass(frozen=True, slots=True)
class ClockSet:
    """The aMussel's clock was set and shows `agent_ms` now: after a reset, or by somebody's beacon."""

    agent_ms: AgentMs


Measurement = (
    StatusPacket | ShortStatus | TimeslotSilent | Permitted | Docked | Released | Fixed | Ranged | ClockSet
)
"""A short status contains neither place nor time, and counts as sent when it was received."""


class Rejected(ValueError):
    """A measurement is not believed; the text is the reason, and the belief stays as it was."""


# As a row of plain data, and back: [kind, aMussel, mission ms, number, ...].

_KINDS: dict[str, type[Any]] = {
    "silent": TimeslotSilent,
    "permitted": Permitted,
    "docked": Docked,
    "released": Released,
    "fixed": Fixed,
    "ranged": Ranged,
    "clock set": ClockSet,
}
_NAMES = {kind: name for name, kind in _KINDS.items()}
_STATUS = "heard"
_SHORT = "short"


def measurement_row(agent_id: int, measurement: Measurement, at_ms: int) -> list[Any]:
    """The row of a measurement: its numbers unchanged, in the order of the fields; a packet's without its id."""
    if isinstance(measurement, StatusPacket):
        it = measurement
        fields = (
            it.sequence,
            int(it.state),
            it.primary,
            it.secondary,
            it.north_m,
            it.east_m,
            it.depth_m,
            it.agent_ms,
        )
        return [_STATUS, agent_id, at_ms, *fields]
    if isinstance(measurement, ShortStatus):
        short = measurement
        return [_SHORT, agent_id, at_ms, int(short.state), short.primary, short.secondary]
    return [_NAMES[type(measurement)], agent_id, at_ms, *astuple(measurement)]


def measurement_of(row: list[Any]) -> tuple[int, Measurement, MissionMs]:
    """The inverse of `measurement_row`; KeyError, TypeError or ValueError for anything else."""
    kind, agent_id, at_ms, *numbers = row
    if kind == _STATUS:
        sequence, state, *rest = numbers
        return agent_id, StatusPacket(agent_id, sequence, State(state), *rest), at_ms
    if kind == _SHORT:
        state, primary, secondary = numbers
        return agent_id, ShortStatus(agent_id, State(state), primary, secondary), at_ms
    measurement: Measurement = _KINDS[kind](*numbers)
    return agent_id, measurement, at_ms
