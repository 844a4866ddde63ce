"""The bench's messages from and to a laboratory's own topics, free of ROS. Stamps are mission milliseconds."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

from agents.packet_medium import Medium


class MessageKind(StrEnum):
    DOCKED = "docked"
    """A dock closed around an aMussel."""
    RELEASED = "released"
    """A dock released an aMussel."""
    PERMISSION = "permission"
    """The permission to surface."""
    CLEAR = "clear"
    """The release payload: it is clear to sink."""
    WIFI = "wifi"
    """An aMussel joined or left the Wi-Fi. Published only."""
    PACKET = "packet"
    """Bytes from an aMussel or for it, in the layout of the scenario's codec."""


@dataclass(frozen=True, slots=True)
class DockReport:
    """A docked alert or, with `closed` false, a release: of an aMussel, a dock, or both; None for the one not named."""

    at_ms: int
    agent_id: int | None
    dock_index: int | None
    closed: bool


@dataclass(frozen=True, slots=True)
class ClearanceMessage:
    """The permission to surface or the release payload for an aMussel; the id is None for all aMussels."""

    what: MessageKind
    agent_id: int | None


@dataclass(frozen=True, slots=True)
class LaboratoryPacket:
    medium: Medium
    agent_id: int | None
    data: bytes


LaboratoryMessage = DockReport | ClearanceMessage | LaboratoryPacket
