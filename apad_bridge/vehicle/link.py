"""How a flight reaches a vehicle and the docks' contacts: the same for the simulated aPad in-process and for one on ROS."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from apad_bridge.vehicle.commands import DockClosed, DockOpened, VehicleCommand, VehicleFact
from apad_bridge.vehicle.simulated.apad import SimulatedAPad


@dataclass(frozen=True, slots=True)
class Carried:
    """A dock holds the aMussel at this place: the world's word to its body, not the mission's."""

    at_ms: int
    agent_id: int
    north_m: float
    east_m: float


@dataclass(frozen=True, slots=True)
class LetGo:
    at_ms: int
    agent_id: int


@dataclass(frozen=True, slots=True)
class APadSeen:
    """Where an aPad is that is somebody else's: the world's word to the water, in which its modem hangs."""

    at_ms: int
    north_m: float
    east_m: float


LinkFact = VehicleFact | Carried | LetGo | APadSeen


class VehicleLink(Protocol):
    def advance(self, now_ms: int) -> list[LinkFact]:
        """What became true by mission time `now_ms` and was not told before, each stamped at or before it.

        May be called again at the same time: after a docking mechanism was commanded it waits a short, stated wall time
        for the answer.
        """
        ...

    def command(self, command: VehicleCommand, now_ms: int) -> None:
        """Passes the command on; what it brings about comes with a later `advance`."""
        ...

    def close(self) -> None: ...


class InProcessVehicle:
    """The simulated aPad in this process."""

    def __init__(self, apad: SimulatedAPad) -> None:
        self.apad = apad
        self._facts: list[VehicleFact] = []

    def advance(self, now_ms: int) -> list[LinkFact]:
        facts = [*self._facts, *self.apad.advance(now_ms)]
        self._facts = []
        told: list[LinkFact] = []
        for fact in facts:
            told.append(fact)
            if isinstance(fact, DockOpened):
                told.append(LetGo(fact.at_ms, fact.agent_id))
            elif isinstance(fact, DockClosed):
                told.append(Carried(fact.at_ms, fact.agent_id, *self.apad.dock_position(fact.dock_index)))
        for dock_index, agent_id in sorted(self.apad.docked.items()):
            told.append(Carried(now_ms, agent_id, *self.apad.dock_position(dock_index)))
        return told

    def command(self, command: VehicleCommand, now_ms: int) -> None:
        self._facts += self.apad.receive(command, now_ms)

    def close(self) -> None:
        pass
