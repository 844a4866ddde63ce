"""What a laboratory's own messages mean to this bench, freed of ROS. Stamps are mission milliseconds."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

from agents.packet_medium import Medium


class What(StrEnum):
    DOCKED = "docked"
    """A dock closed around an aMussel."""
    RELEASED = "released"
    """A dock let one go."""
    PERMISSION = "permission"
    """The permission to surface."""
    CLEAR = "clear"
    """The release payload: it is clear to sink."""
    WIFI = "wifi"
    """Whether an aMussel is on the Wi-Fi. Told only."""
    PACKET = "packet"
    """Bytes, of an aMussel or for it, in the layout of the scenario's codec."""


@dataclass(frozen=True, slots=True)
class DockSaid:
    """A docked alert, or with `closed` false a release: of an aMussel, a slot, or both; None for what was not said."""

    at_ms: int
    agent_id: int | None
    dock_index: int | None
    closed: bool


@dataclass(frozen=True, slots=True)
class WordSaid:
    """The permission to surface or the release payload for an aMussel; None for all of them."""

    what: What
    agent_id: int | None


@dataclass(frozen=True, slots=True)
class PacketSaid:
    medium: Medium
    agent_id: int | None
    data: bytes


Said = DockSaid | WordSaid | PacketSaid
