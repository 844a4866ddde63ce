"""A flight's aMussels: where they live, who lets their time pass, and the water between them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

from agents.coordinator import Coordinator
from agents.hosting.host import Host
from agents.mussel.outputs import Truth
from agents.water.sea import Sea
from agents.water.sea_events import SeaResult
from apad_bridge.links_file import LinksFile
from firmware_model.config import Slots


@dataclass(frozen=True, slots=True)
class Fleet:
    """The agents of a flight, where they live, the clock authority over them, and the water that carries their sound.

    Without a `sea` whatever is said is heard. `slots` are the timeslots that packets are counted in, `links`
    is looked at at each tick.
    """

    coordinator: Coordinator
    host: Host
    sea: Sea | None = None
    slots: Slots | None = None
    links: LinksFile | None = None

    def advance(self, now_ms: int) -> Sequence[SeaResult]:
        return self.coordinator.advance(now_ms) if self.sea is None else self.sea.advance(now_ms)

    @property
    def dropped(self) -> Counter[str]:
        """What the water swallowed that is no packet's outcome."""
        return Counter() if self.sea is None else self.sea.dropped

    def take_truths(self) -> list[Truth]:
        return self.host.take_truths() if self.sea is None else self.sea.take_truths()
