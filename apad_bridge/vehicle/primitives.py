"""Primitives that a mission orders from a docking port, and the port's outcomes.

Positions are local NED metres, times integer milliseconds of mission time. The mission chooses
`primitive_id`, and the outcome repeats it.
"""

from __future__ import annotations

from dataclasses import dataclass

from apad_bridge.vehicle.commands import DEFAULT_MANOEUVRE, Manoeuvre
from apad_bridge.vehicle.docks import Occupancy


@dataclass(frozen=True, slots=True)
class GoToPoint:
    primitive_id: int
    north_m: float
    east_m: float
    speed_m_s: float
    victory_radius_m: float


@dataclass(frozen=True, slots=True)
class HoldPosition:
    """Hold a position. It never completes by itself and succeeds when the next primitive replaces it."""

    primitive_id: int
    north_m: float
    east_m: float


@dataclass(frozen=True, slots=True)
class DockMussel:
    """Take aMussel `agent_id` into dock `dock_index`, where the vehicle is."""

    primitive_id: int
    dock_index: int
    agent_id: int
    manoeuvre: Manoeuvre = DEFAULT_MANOEUVRE


@dataclass(frozen=True, slots=True)
class UndockMussel:
    """Let aMussel `agent_id` go. A dock that the vehicle reported for it overrides `dock_index`."""

    primitive_id: int
    dock_index: int
    agent_id: int
    manoeuvre: Manoeuvre = DEFAULT_MANOEUVRE


Primitive = GoToPoint | HoldPosition | DockMussel | UndockMussel


@dataclass(frozen=True, slots=True)
class PrimitiveSucceeded:
    at_ms: int
    primitive_id: int


@dataclass(frozen=True, slots=True)
class PrimitiveFailed:
    at_ms: int
    primitive_id: int
    reason: str


@dataclass(frozen=True, slots=True)
class NothingCaught:
    """A docking ended before its mechanism moved, because the aMussel does not float within the catch radius."""

    at_ms: int
    primitive_id: int


@dataclass(frozen=True, slots=True)
class DockChanged:
    """A dock closed or opened, ordered or not. The vehicle reports time, dock and aMussel."""

    at_ms: int
    dock_index: int
    agent_id: int
    closed: bool
    docked: Occupancy
    """The port's occupancy after the change."""


PrimitiveEnded = PrimitiveSucceeded | PrimitiveFailed | NothingCaught
Outcome = PrimitiveEnded | DockChanged
