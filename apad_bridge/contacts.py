"""The docks' contacts as the bodies feel them: closing, being carried, opening. The world's business, not the mission's."""

from __future__ import annotations

from collections.abc import Iterable

from agents.mussel.stimuli import ContactClosed, ContactOpened, DockMoved, Stimulus
from apad_bridge.vehicle.link import Carried, LetGo


class Contacts:
    """Remembers where each docked aMussel was last carried, so that only what changes is told."""

    def __init__(self, held: Iterable[int] = ()) -> None:
        self._places: dict[int, tuple[int, int] | None] = dict.fromkeys(held)
        """By agent; None for one that was docked before anything was told here."""

    def take(self, fact: Carried | LetGo) -> Stimulus | None:
        """The stimulus that the aMussel's body gets; None when nothing changed for it."""
        if isinstance(fact, LetGo):
            if fact.agent_id not in self._places:
                return None
            del self._places[fact.agent_id]
            return ContactOpened()
        place = (round(fact.north_m * 1e6), round(fact.east_m * 1e6))
        if fact.agent_id not in self._places:
            self._places[fact.agent_id] = place
            return ContactClosed(*place)
        before, self._places[fact.agent_id] = self._places[fact.agent_id], place
        return DockMoved(*place) if place != before else None
