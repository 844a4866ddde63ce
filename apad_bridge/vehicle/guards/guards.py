"""The guards: pure functions of an order and a situation. Each refuses for one cause, with a reason for people.

No guard refuses a stop (`is_stop`); the gate asks none about it.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

from apad_bridge.beliefs.input_ranges import out_of_range
from apad_bridge.vehicle.commands import CloseDock, GoTo, Hold, MoveArm, OpenDock
from apad_bridge.vehicle.guards.guarded_orders import (
    BodyInWater,
    GuardedOrder,
    Point,
    Surfacing,
    VehicleSituation,
    goal_of,
)
from apad_bridge.vehicle.guards.waters import Waters

SAME_M = 0.5
"""A goal so near to the nearest place inside the fence is that place."""
AT_GOAL_M = 3.0
"""A go-to that ends so near to an aMussel goes to it."""


class Guard(Protocol):
    @property
    def name(self) -> str: ...

    def refusal(self, order: GuardedOrder, situation: VehicleSituation) -> str:
        """The reason to refuse the order; empty to let it pass."""


@dataclass(frozen=True, slots=True)
class SoundNumbers:
    """Refuses places that are not finite or beyond every water, and speeds and radii that are not above 0."""

    name: str = "numbers"

    def refusal(self, order: GuardedOrder, situation: VehicleSituation) -> str:
        goal_m = goal_of(order)
        if goal_m is not None and (reason := out_of_range(north_m=goal_m[0], east_m=goal_m[1])) is not None:
            return f"the goal's {reason}"
        if isinstance(order, GoTo):
            for name, number in (("speed", order.speed_m_s), ("victory radius", order.victory_radius_m)):
                if not (math.isfinite(number) and number > 0):
                    return f"the {name} must be finite and above 0"
        return ""


@dataclass(frozen=True, slots=True)
class GoodPosition:
    """Refuses to move the vehicle on a position that is missing, old, or not to be believed."""

    name: str = "position"

    def refusal(self, order: GuardedOrder, situation: VehicleSituation) -> str:
        return "" if isinstance(order, Surfacing) else situation.position_fault


@dataclass(frozen=True, slots=True)
class PersonsWord:
    """Refuses everything while a person's word is awaited."""

    name: str = "person"

    def refusal(self, order: GuardedOrder, situation: VehicleSituation) -> str:
        return situation.awaits_person


@dataclass(frozen=True, slots=True)
class InWaters:
    """Keeps the whole way, each docking, and each aMussel called up inside the fence and out of keep-out zones."""

    waters: Waters
    returns: bool = False
    """From outside, the straight way to the nearest place inside is let pass."""
    name: str = "fence"

    def refusal(self, order: GuardedOrder, situation: VehicleSituation) -> str:
        match order:
            case GoTo() | Hold():
                return self._way(order, situation)
            case CloseDock() | OpenDock() | MoveArm():
                return "" if situation.place_m is None else self.waters.fault_of_place(situation.place_m)
            case Surfacing(agent_id, place_m) if place_m is not None:
                fault = self.waters.fault_of_place(place_m)
                return fault and f"aMussel {agent_id} would surface where no aPad may go: {fault}"
        return ""

    def _way(self, order: GoTo | Hold, situation: VehicleSituation) -> str:
        place_m, goal_m = situation.place_m, (order.north_m, order.east_m)
        if place_m is None:
            return "the way cannot be checked without a position"
        if self.returns and self.waters.fault_of_place(place_m):
            inside_m = self.waters.nearest_inside(place_m)
            if inside_m is not None and math.dist(inside_m, goal_m) <= SAME_M:
                return ""
        return self.waters.fault_of_way(place_m, goal_m)


@dataclass(frozen=True, slots=True)
class RoomToDock:
    """Keeps a visual docking clear of the fence: the vehicle drifts in it, searches, and pulls back."""

    waters: Waters
    room_m: float
    is_visual: Callable[[int], bool]
    """True for an aMussel that is docked by visual servoing."""
    name: str = "room to dock"

    def refusal(self, order: GuardedOrder, situation: VehicleSituation) -> str:
        if not isinstance(order, CloseDock | OpenDock) or not self.is_visual(order.agent_id):
            return ""
        if situation.place_m is None:
            return "the room for a visual docking cannot be checked without a position"
        fault = self.waters.fault_of_room(situation.place_m, self.room_m)
        return fault and f"a visual docking needs room: {fault}"


@dataclass(frozen=True, slots=True)
class LegLimits:
    """The greatest length (m), speed (m/s) and duration (s) of a leg; infinity for no limit."""

    length_m: float = math.inf
    speed_m_s: float = math.inf
    duration_s: float = math.inf
    name: str = "leg"

    def refusal(self, order: GuardedOrder, situation: VehicleSituation) -> str:
        goal_m = goal_of(order)
        if goal_m is None or situation.place_m is None:
            return ""
        way_m = math.dist(situation.place_m, goal_m)
        if way_m > self.length_m:
            return f"the leg is {way_m:.1f} m long, the greatest is {self.length_m:g} m"
        if not isinstance(order, GoTo):
            return ""
        if order.speed_m_s > self.speed_m_s:
            return f"its speed is {order.speed_m_s:g} m/s, the greatest is {self.speed_m_s:g} m/s"
        if way_m / order.speed_m_s > self.duration_s:
            return f"the leg takes {way_m / order.speed_m_s:.0f} s, the longest is {self.duration_s:g} s"
        return ""


@dataclass(frozen=True, slots=True)
class BatteryForHome:
    """Keeps `reserve` of the battery for the end of a straight way home after the leg. A leg towards home is let pass."""

    home_m: Point
    reserve: float
    fraction: Callable[[Point, Point, int], float]
    """The charge that a straight leg costs, at its time."""
    name: str = "battery"

    def refusal(self, order: GuardedOrder, situation: VehicleSituation) -> str:
        goal_m, place_m = goal_of(order), situation.place_m
        if goal_m is None or place_m is None:
            return ""
        if math.dist(goal_m, self.home_m) <= math.dist(place_m, self.home_m):
            return ""
        if situation.battery_fraction is None:
            return "the charge of the aPad's battery is not known, and the way home needs some"
        legs = self.fraction(place_m, goal_m, situation.at_ms) + self.fraction(
            goal_m, self.home_m, situation.at_ms
        )
        needed = self.reserve + legs
        if situation.battery_fraction >= needed:
            return ""
        return (
            f"the aPad's battery holds {100 * situation.battery_fraction:.1f} %, and the leg and the way home need "
            f"{100 * needed:.1f} %"
        )


@dataclass(frozen=True, slots=True)
class ClearOfBodies:
    """Keeps a way `least_m` clear of real aMussels at the surface and of other aPads.

    The aMussel at the way's goal is not in the way. A way that begins nearer to a body may not come nearer still.
    """

    least_m: float
    name: str = "bodies"

    def refusal(self, order: GuardedOrder, situation: VehicleSituation) -> str:
        goal_m, start_m = goal_of(order), situation.place_m
        if goal_m is None or start_m is None:
            return ""
        wanted = _body_at(goal_m, situation.bodies)
        for body in situation.bodies:
            passing_m = _distance_m(body.place_m, start_m, goal_m)
            least_m = min(self.least_m, math.dist(start_m, body.place_m))
            if body != wanted and passing_m < least_m - 1e-6:
                return f"the way passes {body.name} at {passing_m:.1f} m, the least is {self.least_m:g} m"
        return ""


def unlimited_guards() -> list[Guard]:
    """The guards of each aPad, also of a simulated one without limits of its own."""
    return [SoundNumbers(), PersonsWord(), GoodPosition()]


def _body_at(goal_m: Point, bodies: tuple[BodyInWater, ...]) -> BodyInWater | None:
    """The aMussel to which a way to this goal leads."""
    there = [it for it in bodies if it.agent_id is not None and math.dist(it.place_m, goal_m) <= AT_GOAL_M]
    return min(there, key=lambda it: math.dist(it.place_m, goal_m), default=None)


def _distance_m(place_m: Point, start_m: Point, goal_m: Point) -> float:
    """From a place to the nearest point of a straight way."""
    north_m, east_m = goal_m[0] - start_m[0], goal_m[1] - start_m[1]
    length_2 = north_m**2 + east_m**2
    along = (place_m[0] - start_m[0]) * north_m + (place_m[1] - start_m[1]) * east_m
    fraction = min(1.0, max(0.0, along / length_2)) if length_2 > 0 else 0.0
    return math.dist(place_m, (start_m[0] + fraction * north_m, start_m[1] + fraction * east_m))
