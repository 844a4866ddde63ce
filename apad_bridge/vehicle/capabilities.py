"""Capabilities of a vehicle behind the docking port: what its stack can do, and where its docks are.

Each stack states its own, in `vehicle/generation_NAME/stack.py`; the registry `assembly/stacks.py` lists the stacks.
Whoever needs to know asks a capability and never the name of a stack.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from apad_bridge.scenario.choices import PAPER_DOCKS

_PUBLISHED_M = ((-0.1, -0.1), (-0.1, 0.1), (0.1, -0.1), (0.1, 0.1))


@dataclass(frozen=True, slots=True)
class DockPlaces:
    """The places at which a vehicle's docks hold aMussels, in metres from its middle, by dock index.

    Places are (ahead, to the right) where they `turn_with_hull`, else (north, east).
    """

    offsets_m: tuple[tuple[float, float], ...]
    turn_with_hull: bool

    @property
    def count(self) -> int:
        """The number of docks."""
        return len(self.offsets_m)

    @property
    def indices(self) -> range:
        """The docks' indices, from 0."""
        return range(len(self.offsets_m))

    @property
    def bearings_rad(self) -> tuple[float, ...]:
        """The directions of the docks, clockwise from the bow (or from north), in [0, 2 pi)."""
        return tuple(math.atan2(right_m, ahead_m) % math.tau for ahead_m, right_m in self.offsets_m)

    def place_m(
        self, dock_index: int, north_m: float, east_m: float, heading_rad: float
    ) -> tuple[float, float]:
        """The place (north, east) at which a dock holds its aMussel, for a vehicle with this pose."""
        ahead_m, right_m = self.offsets_m[dock_index]
        if not self.turn_with_hull:
            return north_m + ahead_m, east_m + right_m
        bearing_rad = heading_rad + math.atan2(right_m, ahead_m)
        distance_m = math.hypot(ahead_m, right_m)
        return north_m + distance_m * math.cos(bearing_rad), east_m + distance_m * math.sin(bearing_rad)


@dataclass(frozen=True, slots=True)
class Capabilities:
    """The abilities of a stack that a mission builds on."""

    docks: DockPlaces
    sees_amussels: bool
    """It docks by visual servoing, which a simulated camera can feed."""
    can_hold: bool
    """It has an order to hold a position. Without one, a hold is a go-to, at whose end the vehicle stays."""
    reports_contact: bool
    """It publishes which aMussels its docks hold. For other vehicles the bench keeps the docks."""
    obeys_speed: bool
    """A go-to carries speed and victory radius. Without them, both are settings of the vehicle."""
    moves_arms: bool
    """It has an order that moves a dock's arm and catches nothing."""


def published_docks(count: int) -> DockPlaces:
    """The places of the public simulator's aPad, which holds its aMussels beside it and does NOT turn them with the hull.

    A comparison with it should show the same places. For any other number than its four docks, places are assumed: even
    steps on the same circle, clockwise from north.
    """
    if count == len(_PUBLISHED_M):
        return DockPlaces(_PUBLISHED_M, turn_with_hull=False)
    radius_m = math.hypot(*_PUBLISHED_M[0])
    bearings_rad = [math.tau * dock_index / count for dock_index in range(count)]
    offsets_m = tuple((radius_m * math.cos(it), radius_m * math.sin(it)) for it in bearings_rad)
    return DockPlaces(offsets_m, turn_with_hull=False)


def of_simulated_apad(docks: int = PAPER_DOCKS) -> Capabilities:
    """The simulated aPad in the flight's own process, with no stack between: it takes the port's commands as they are."""
    return Capabilities(
        published_docks(docks),
        sees_amussels=False,
        can_hold=True,
        reports_contact=True,
        obeys_speed=True,
        moves_arms=False,
    )
