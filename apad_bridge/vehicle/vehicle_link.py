"""A flight's interface to its vehicle and the docks' contacts, alike for an in-process aPad and an aPad on ROS."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import TYPE_CHECKING, Generic, Protocol, TypeVar

from apad_bridge.vehicle.commands import (
    PoseReported,
    VehicleCommand,
    VehicleFact,
)

if TYPE_CHECKING:
    pass


@dataclass(frozen=True, slots=True)
class Carried:
    """A dock holds the aMussel at this place. The fact goes to the aMussel's body, not to the mission."""

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
    """The position of an aPad that somebody else commands. It goes to the water, where the aPad's modem hangs."""

    at_ms: int
    north_m: float
    east_m: float


LinkFact = VehicleFact | Carried | LetGo | APadSeen


Sendable = TypeVar("Sendable")


class Cleared(ABC, Generic[Sendable]):
    """An order that the gate has let out: a vehicle's command, or what goes on the wire for one.

    Only `Gate` has a class that can be made, and a link takes nothing else: so a type check finds a road around the guards.
    """

    @property
    @abstractmethod
    def order(self) -> Sendable: ...

    @property
    @abstractmethod
    def under(self) -> int:
        """The number of the latch (`guards/stops.py`) under which the gate let it out."""


class VehicleLink(Protocol):
    def advance(self, now_ms: int) -> list[LinkFact]:
        """New facts up to mission time `now_ms`, each stamped at or before it and returned once.

        The caller may repeat the call at the same time: after a command to a docking mechanism it waits a
        short, stated wall time for the answer.
        """

    def command(self, cleared: Cleared[VehicleCommand], now_ms: int) -> None:
        """Passes the command on; a later `advance` returns its consequences."""

    def close(self) -> None: ...


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

    def command(self, cleared: Cleared[VehicleCommand], now_ms: int) -> None:
        raise RuntimeError("a fleet alone commands no vehicle")

    def close(self) -> None:
        self._link.close()
