"""Packets between aMussels and a supervisor that live in different processes: a fleet without a mission, or the reverse."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

from agents.mussel.stimuli import Stimulus
from agents.packet_medium import Medium
from apad_bridge.mission.events import Send, SoundHeard, WifiHeard


@dataclass(frozen=True, slots=True)
class Felt:
    """Something that an aMussel of this fleet felt of an aPad whose supervisor is elsewhere."""

    agent_id: int
    stimulus: Stimulus


Came = WifiHeard | SoundHeard | Send | Felt
TellServedElsewhere = Callable[[Felt, int], None]
"""Lets a guest, which is simulated elsewhere, feel what an aPad's docks do, at a mission time."""


class PacketRelay(Protocol):
    def advance(self, now_ms: int) -> Sequence[Came]:
        """What came from the other side by mission time `now_ms`: an aMussel's transmissions, or what reaches one."""
        ...

    def transmit(self, medium: Medium, agent_id: int, data: bytes, now_ms: int) -> None:
        """Sends a packet to the other side: of this aMussel, or for it."""
        ...

    def said(self, send: Send, now_ms: int) -> None:
        """The supervisor of this process said this, to an aMussel of this process or to a guest."""
        ...
