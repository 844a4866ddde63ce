"""The vehicle link to the simulated aPad in the flight's own process."""

from __future__ import annotations

from apad_bridge.vehicle.commands import DockClosed, DockOpened, DocksNamed, VehicleCommand, VehicleFact
from apad_bridge.vehicle.vehicle_link import Carried, Cleared, LetGo, LinkFact
from apad_bridge.world.apad.simulated_apad import SimulatedAPad


class InProcessVehicle:
    """The simulated aPad in this process."""

    def __init__(self, apad: SimulatedAPad) -> None:
        self.apad = apad
        self._facts: list[VehicleFact] = []
        self._named: frozenset[int] = frozenset()
        """The aMussels that it has named as those in its docks."""

    def advance(self, now_ms: int) -> list[LinkFact]:
        facts = [*self._facts, *self.apad.advance(now_ms)]
        self._facts = []
        link_facts: list[LinkFact] = []
        for fact in facts:
            link_facts.append(fact)
            if isinstance(fact, DockOpened):
                link_facts.append(LetGo(fact.at_ms, fact.agent_id))
            elif isinstance(fact, DockClosed):
                link_facts.append(
                    Carried(fact.at_ms, fact.agent_id, *self.apad.dock_position(fact.dock_index))
                )
        for dock_index, agent_id in sorted(self.apad.docked.items()):
            link_facts.append(Carried(now_ms, agent_id, *self.apad.dock_position(dock_index)))
        # It answers as generation A does when it is asked after a docking, and after a resume.
        held = frozenset(self.apad.docked.values())
        if held and held != self._named:
            link_facts.append(DocksNamed(now_ms, held, held))
        self._named = held
        return link_facts

    def command(self, cleared: Cleared[VehicleCommand], now_ms: int) -> None:
        self._facts += self.apad.receive(cleared.order, now_ms)

    def close(self) -> None:
        pass
