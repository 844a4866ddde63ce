"""A VehicleLink of a fleet alone: of what the vehicle's link tells only the docks' contacts are passed on."""

from __future__ import annotations

from apad_bridge.vehicle import VehicleCommand
from apad_bridge.vehicle_link import Carried, LetGo, LinkFact, VehicleLink


class ListeningLink:
    """For generation B, whose docks are the bench's to know: somebody else's planner docks its aMussels."""

    def __init__(self, link: VehicleLink) -> None:
        self._link = link

    def advance(self, now_ms: int) -> list[LinkFact]:
        facts = self._link.advance(now_ms)
        return [fact for fact in facts if isinstance(fact, Carried | LetGo)]

    def command(self, command: VehicleCommand, now_ms: int) -> None:
        raise RuntimeError("a fleet alone commands no vehicle")

    def close(self) -> None:
        self._link.close()
