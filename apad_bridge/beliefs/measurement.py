"""Everything that an aPad can know of one aMussel: packets received or missed, its own actions, and position fixes.

A received packet is a measurement as it was decoded. The mission time of a measurement stands beside it. There is no
measurement of truth. A measurement may become a row of plain data, and back.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from functools import cache
from typing import Any

from pydantic import TypeAdapter

from agents.time_scale import AgentMs, MissionMs
from firmware_model.packets import AcousticStatus, ShortStatus, StatusPacket, WifiStatus


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


@dataclass(frozen=True, slots=True)
class HandedOver:
    """The id is that of another board from now on, with a clock and sensors of its own.

    One that was `placed` lies on the bottom at the believed place, with the believed charges.
    """

    placed: bool


Measurement = (
    StatusPacket
    | ShortStatus
    | TimeslotSilent
    | Permitted
    | Docked
    | Released
    | Fixed
    | Ranged
    | ClockSet
    | HandedOver
)
"""A short status contains neither place nor time, and counts as sent when it was received."""


class Rejected(ValueError):
    """A measurement is not believed; the text is the reason, and the belief stays as it was."""


# As a row of plain data, and back: [kind, aMussel, mission ms, number, ...].

_KINDS: dict[str, type[Any]] = {
    "heard": StatusPacket,
    "heard by sound": AcousticStatus,
    "heard in full": WifiStatus,
    "short": ShortStatus,
    "silent": TimeslotSilent,
    "permitted": Permitted,
    "docked": Docked,
    "released": Released,
    "fixed": Fixed,
    "ranged": Ranged,
    "clock set": ClockSet,
    "handed over": HandedOver,
}
_NAMES = {kind: name for name, kind in _KINDS.items()}
_FIELDS = {kind: [it.name for it in fields(kind) if it.name != "agent_id"] for kind in _NAMES}


@cache
def _adapter(name: str) -> TypeAdapter[Any]:
    return TypeAdapter(_KINDS[name])


def measurement_row(agent_id: int, measurement: Measurement, at_ms: int) -> list[Any]:
    """The row of a measurement: its numbers unchanged, in the order of the fields; a packet's without its id."""
    kind = type(measurement)
    return [_NAMES[kind], agent_id, at_ms, *(getattr(measurement, it) for it in _FIELDS[kind])]


def measurement_of(row: list[Any]) -> tuple[int, Measurement, MissionMs]:
    """The inverse of `measurement_row`; KeyError, TypeError or ValueError for anything else."""
    name, agent_id, at_ms, *numbers = row
    values = dict(zip(_FIELDS[_KINDS[name]], numbers, strict=True))
    measurement: Measurement = _adapter(name).validate_python({"agent_id": agent_id, **values})
    return agent_id, measurement, at_ms
