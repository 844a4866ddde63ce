"""A VehicleLink for a fleet alone, which passes contacts and the aPad's position to the world, not to a mission."""

from __future__ import annotations

from apad_bridge.vehicle.commands import PoseReported, VehicleCommand
from apad_bridge.vehicle.link import APadSeen, Carried, LetGo, LinkFact, VehicleLink


class ListeningLink:
    """For a generation B aPad: only the bench tracks its docks, while somebody else's planner docks."""

    def __init__(self, link: VehicleLink) -> None:
        self._link = link

    def advance(self, now_ms: int) -> list[LinkFact]:
        """The docks' contacts, and the aPad's position."""
        facts: list[LinkFact] = []
        for fact in self._link.advance(now_ms):
            if isinstance(fact, PoseReported):
                facts.append(APadSeen(fact.at_ms, fact.north_m, fact.east_m))
            elif isinstance(fact, Carried | LetGo | APadSeen):
                facts.append(fact)
        return facts

    def command(self, command: VehicleCommand, now_ms: int) -> None:
        raise RuntimeError("a fleet alone commands no vehicle")

    def close(self) -> None:
        self._link.close()
