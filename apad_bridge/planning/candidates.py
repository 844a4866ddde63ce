"""A planner's input: the aPad's place, and the agents that it may serve, as the mission BELIEVES them to be.

The planner cannot name truth: its input comes from beliefs about agents and never from the agents.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import dist, isfinite
from typing import Protocol, runtime_checkable

from apad_bridge.planning.energy_model import EnergyModel
from firmware_model.packets import NOTHING_REPORTED, Reported


@dataclass(frozen=True, slots=True)
class Candidate:
    """One agent as the mission believes it to be: in the pool, waiting to be collected, or docked.

    Places are local NED metres. `charge` and `secondary` are the two batteries' scaled voltages in [0, 1].
    A docked agent goes back to its home. `dock_index` is the dock that holds it, None while it is in the water.
    """

    agent_id: int
    north_m: float
    east_m: float
    charge: float
    secondary: float
    home_north_m: float
    home_east_m: float
    dock_index: int | None = None
    unserved_s: float = 0.0
    """The mission seconds since it was released last, or since the start."""
    is_served: bool = False
    """The mission brought it back at least once."""
    reported: Reported = NOTHING_REPORTED

    def __post_init__(self) -> None:
        numbers = (
            self.north_m,
            self.east_m,
            self.charge,
            self.secondary,
            self.home_north_m,
            self.home_east_m,
        )
        if not all(isfinite(number) for number in numbers):
            raise ValueError(f"aMussel {self.agent_id}: a planner needs finite numbers, not {numbers}")

    @property
    def place_m(self) -> tuple[float, float]:
        """Its believed place: metres (north, east) of the origin."""
        return (self.north_m, self.east_m)

    @property
    def home_m(self) -> tuple[float, float]:
        """Its home, in the same metres."""
        return (self.home_north_m, self.home_east_m)


@runtime_checkable
class LegCosts(Protocol):
    """The current and the wind on the aPad's straight legs, at the time of a decision."""

    def metres(self, from_m: tuple[float, float], to_m: tuple[float, float]) -> float:
        """The metres of calm water that take as much of the thrusters' energy as this leg."""

    def seconds(self, from_m: tuple[float, float], to_m: tuple[float, float]) -> float:
        """The time of the way at its speed over ground. It is very long where the aPad makes no way."""


@dataclass(frozen=True, slots=True)
class Situation:
    """The input of one plan. The candidates of a collection are in the pool, those of a redeployment are docked.

    `others` are the rest of the fleet: in the water above the pool's threshold, or docked (`dock_index` is known).
    `leaving` are docked ones that leave while a collection is flown: each takes the place of a collected one, in this order
    (`planning/exchange_of_places.py`). Their docks count as free. `model` is what a strategy that looks ahead may assume;
    None where nobody knows it, as in a script's plan. Without a `sea` the water is calm.

    Raises ValueError if an agent or a dock is named twice.
    """

    apad_north_m: float
    apad_east_m: float
    candidates: tuple[Candidate, ...]
    free_docks: tuple[int, ...]
    others: tuple[Candidate, ...] = ()
    model: EnergyModel | None = None
    leaving: tuple[Candidate, ...] = ()
    sea: LegCosts | None = None

    def __post_init__(self) -> None:
        staying = (*self.candidates, *self.others)
        known = (*staying, *self.leaving)
        ids = [candidate.agent_id for candidate in known]
        if len(set(ids)) != len(ids):
            raise ValueError(f"an aMussel is a candidate twice: {sorted(ids)}")
        taken = [candidate.dock_index for candidate in staying if candidate.dock_index is not None]
        docks = [*self.free_docks, *taken]
        if len(set(docks)) != len(docks):
            raise ValueError(f"a dock is free and taken, or named twice: {sorted(docks)}")

    @property
    def apad_m(self) -> tuple[float, float]:
        """The aPad's place, in the same metres."""
        return (self.apad_north_m, self.apad_east_m)

    def metres(self, from_m: tuple[float, float], to_m: tuple[float, float]) -> float:
        """The length of a leg, or that of a leg in calm water that costs as much."""
        return dist(from_m, to_m) if self.sea is None else self.sea.metres(from_m, to_m)

    def seconds(self, from_m: tuple[float, float], to_m: tuple[float, float], speed_m_s: float) -> float:
        """The time of a leg; `speed_m_s` is that in calm water."""
        return dist(from_m, to_m) / speed_m_s if self.sea is None else self.sea.seconds(from_m, to_m)
