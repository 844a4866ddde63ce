"""A VehicleLink of a fleet alone: what the vehicle's link tells is passed on as the world's, not as a mission's."""

from __future__ import annotations

from apad_bridge.vehicle.commands import PoseReported, VehicleCommand
from apad_bridge.vehicle.link import APadSeen, Carried, LetGo, LinkFact, VehicleLink


class ListeningLink:
    """For generation B, whose docks are the bench's to know: somebody else's planner docks its aMussels."""

    def __init__(self, link: VehicleLink) -> None:
        self._link = link

    def advance(self, now_ms: int) -> list[LinkFact]:
        """The docks' contacts, and where the aPad is."""
        told: list[LinkFact] = []
        for fact in self._link.advance(now_ms):
            if isinstance(fact, PoseReported):
                told.append(APadSeen(fact.at_ms, fact.north_m, fact.east_m))
            elif isinstance(fact, Carried | LetGo | APadSeen):
                told.append(fact)
        return told

    def command(self, command: VehicleCommand, now_ms: int) -> None:
        raise RuntimeError("a fleet alone commands no vehicle")

    def close(self) -> None:
        self._link.close()
