"""Relays packets between aMussels and a supervisor in different processes: a fleet without a mission, or the reverse."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

from agents.mussel.stimuli import Stimulus
from agents.packet_medium import Medium
from apad_bridge.mission.events import Send, SoundHeard, WifiHeard


@dataclass(frozen=True, slots=True)
class RemoteContact:
    """A stimulus that an aMussel of this fleet gets from an aPad whose supervisor is elsewhere."""

    agent_id: int
    stimulus: Stimulus


RelayedEvent = WifiHeard | SoundHeard | Send | RemoteContact
SendContact = Callable[[RemoteContact, int], None]
"""Delivers a stimulus of an aPad's docks to an aMussel that is simulated elsewhere, at a mission time."""


class PacketRelay(Protocol):
    def advance(self, now_ms: int) -> Sequence[RelayedEvent]:
        """Returns the items from the other side up to mission time `now_ms`: packets from aMussels, or items for them."""
        ...

    def transmit(self, medium: Medium, agent_id: int, data: bytes, now_ms: int) -> None:
        """Sends a packet from or to this aMussel to the other side."""
        ...

    def forward(self, send: Send, now_ms: int) -> None:
        """Handles a packet that the supervisor of this process sent, to an aMussel of this fleet or of another."""
        ...
