"""Facts that reach the supervisor, and its actions. Stamps are mission milliseconds."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from agents.packet_medium import Medium
from agents.time_scale import AgentMs, MissionMs
from apad_bridge.events.event import Event
from apad_bridge.events.fleet_events import Presence, PresenceChanged
from apad_bridge.events.mission_events import MissionEnd
from apad_bridge.mission.orders import VehicleOrder
from apad_bridge.vehicle.commands import VehicleCommand, VehicleFact
from firmware_model.packets.sample_record import SampleRecord
from firmware_model.value import value

_AT_ONCE = AgentMs(0)


@value
class AMusselHeard:
    """Bytes that came from an aMussel, or from something that passes for one."""

    medium: Medium
    at_ms: MissionMs
    data: bytes


@dataclass(frozen=True, slots=True)
class RangeHeard:
    """An aMussel answered a ping from `range_m`; None without an answer in time."""

    at_ms: MissionMs
    agent_id: int
    range_m: float | None


@dataclass(frozen=True, slots=True)
class EndRequested:
    """The mission shall end."""

    at_ms: MissionMs
    end: MissionEnd


@dataclass(frozen=True, slots=True)
class StandDownRequested:
    """One of several aPads must leave its aMussels to the others."""

    at_ms: MissionMs
    reason: str


Fact = AMusselHeard | RangeHeard | EndRequested | StandDownRequested | VehicleFact


@dataclass(frozen=True, slots=True)
class Send:
    """Transmit to one aMussel, or by sound to all (EVERYONE).

    Sound goes out at agent time `not_before_ms`, or as soon as the modem is free.
    """

    medium: Medium
    agent_id: int
    data: bytes
    not_before_ms: AgentMs = _AT_ONCE


@dataclass(frozen=True, slots=True)
class Ping:
    """Measure the range to an aMussel by sound; a RangeHeard follows."""

    agent_id: int
    not_before_ms: AgentMs = _AT_ONCE


class SampleSource(NamedTuple):
    """A board with a log of its own: each counts its samples from 0, and several take an aMussel's id in turn."""

    agent_id: int
    real_since_ms: int | None = None
    """The mission time at which the id was taken from a simulated aMussel; None for the simulated one's board."""

    @classmethod
    def after(cls, change: PresenceChanged, at_ms: int) -> SampleSource:
        """The board that samples under this id come from after the change, until the next one."""
        return cls(change.id, None if change.is_ is Presence.SIMULATED else at_ms)


@dataclass(frozen=True, slots=True)
class PlacedSample:
    """An uploaded sample, and where the supervisor believes that it was taken."""

    record: SampleRecord
    place_m: tuple[float, float] | None
    """(north, east); None where nothing was believed of the aMussel at that time."""


@dataclass(frozen=True, slots=True)
class KeepSamples:
    """Put an aMussel's samples on disk before anything else goes out: their acknowledgement follows."""

    agent_id: int
    samples: tuple[PlacedSample, ...]


SupervisorAction = VehicleCommand | Send | Ping | Event | KeepSamples | VehicleOrder
