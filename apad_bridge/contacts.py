"""The docks' contacts as the bodies feel them: closing, being carried, opening. The world's business, not the mission's."""

from __future__ import annotations

from agents.stimuli import ContactClosed, ContactOpened, DockMoved, Stimulus
from apad_bridge.vehicle_link import Carried, LetGo


class Contacts:
    """Remembers where each docked aMussel was last carried, so that only what changes is told."""

    def __init__(self) -> None:
        self._places: dict[int, tuple[int, int]] = {}

    def take(self, fact: Carried | LetGo) -> Stimulus | None:
        """The stimulus that the aMussel's body gets; None when nothing changed for it."""
        if isinstance(fact, LetGo):
            return ContactOpened() if self._places.pop(fact.agent_id, None) is not None else None
        place = (round(fact.north_m * 1e6), round(fact.east_m * 1e6))
        before = self._places.get(fact.agent_id)
        self._places[fact.agent_id] = place
        if before is None:
            return ContactClosed(*place)
        return DockMoved(*place) if place != before else None
