"""Packets between aMussels and a supervisor that live in different processes: a fleet without a mission, or the reverse."""

from __future__ import annotations

from typing import Protocol

from apad_bridge.facts import Medium, Send, SoundHeard, WifiHeard


class Ether(Protocol):
    def advance(self, now_ms: int) -> list[WifiHeard | SoundHeard | Send]:
        """What came from the other side by mission time `now_ms`: an aMussel's transmissions, or words to one."""
        ...

    def transmit(self, medium: Medium, agent_id: int, data: bytes, now_ms: int) -> None:
        """Sends a packet to the other side: of this aMussel, or for it."""
        ...

    def said(self, send: Send, now_ms: int) -> None:
        """The supervisor of this process said this to an aMussel of this process: for whoever else wants to know."""
        ...
