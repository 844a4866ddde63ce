"""Orders that move a vehicle or an aMussel, and the situation in which a guard judges them.

Positions are local NED metres, speeds m/s, times integer ms of mission time, charges fractions of a full battery.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from apad_bridge.vehicle.commands import GoTo, Hold, PilotLeft, Stop, VehicleCommand

Point = tuple[float, float]
HERE_M = 0.05
"""A hold no farther than this from the newest position moves nothing."""
NEAR_HERE_M = 3.0
"""A refused hold no farther than this, and two seconds of the vehicle's way, is meant as a stop: it becomes a hold here."""
_STOP_DELAY_S = 2.0


@dataclass(frozen=True, slots=True)
class Surfacing:
    """Permission to surface for an aMussel that is believed at `place_m`, None for one that was never heard."""

    agent_id: int
    place_m: Point | None


GuardedOrder = VehicleCommand | Surfacing


@dataclass(frozen=True, slots=True)
class BodyInWater:
    """Something in the water that a hull must not touch: a real aMussel that floats, or another aPad."""

    name: str
    place_m: Point
    agent_id: int | None
    """None for an aPad."""


@dataclass(frozen=True, slots=True)
class VehicleSituation:
    place_m: Point | None
    """The newest position of the vehicle, good or bad; None before the first."""
    velocity_m_s: Point = (0.0, 0.0)
    """(north, east), from the newest positions."""
    least_speed_m_s: float = 0.0
    """The speed that the vehicle makes at least, by the error of its velocity."""
    position_fault: str = ""
    """The reason not to use the position; empty for a good one."""
    outside: str = ""
    """The reason why the vehicle may not be where it is; empty inside the waters."""
    battery_fraction: float | None = None
    bodies: tuple[BodyInWater, ...] = ()
    awaits_person: str = ""
    """The reason why nothing moves until a person allows it; empty while nothing is in the way."""
    at_ms: int = 0
    watchdog_fault: str = ""
    """The reason why the vehicle's own watchdog does not watch; empty where it does, or where none is known."""

    @property
    def speed_m_s(self) -> float:
        return math.hypot(*self.velocity_m_s)


def goal_of(order: GuardedOrder) -> Point | None:
    """The place to which the order moves the vehicle; None for an order that names none."""
    return (order.north_m, order.east_m) if isinstance(order, GoTo | Hold) else None


def may_hold(situation: VehicleSituation) -> bool:
    """True where the vehicle may hold its place: a position that is believed, inside the waters."""
    return situation.place_m is not None and not situation.position_fault and not situation.outside


def is_stop(order: GuardedOrder, situation: VehicleSituation) -> bool:
    """True for an order that only ends a motion: controllers off, or a hold where the vehicle is and may hold.

    An arm that closes is none: it moves something, and the hull goes on.
    """
    match order:
        case Stop() | PilotLeft():
            return True
        case Hold(_, north_m, east_m) if may_hold(situation) and situation.place_m is not None:
            is_here = math.dist(situation.place_m, (north_m, east_m)) <= HERE_M
            # A stop that the vehicle has not taken yet is repeated, while it moves on.
            return is_here or (order.pre_empts and is_meant_as_stop(order, situation))
        case _:
            return False


def is_meant_as_stop(order: GuardedOrder, situation: VehicleSituation) -> bool:
    """True for a hold near the newest position, good or bad."""
    if not isinstance(order, Hold) or situation.place_m is None:
        return False
    near_m = NEAR_HERE_M + _STOP_DELAY_S * situation.speed_m_s
    return math.dist(situation.place_m, (order.north_m, order.east_m)) <= near_m
