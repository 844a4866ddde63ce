"""What the mission orders of a docking port, and what it hears back.

Positions are local NED metres, times integer milliseconds of mission time. `primitive_id` is the mission's own and
comes back in the outcome.
"""

from __future__ import annotations

from dataclasses import dataclass

from apad_bridge.vehicle.commands import AS_THE_SCENARIO_SAYS, Manoeuvre


@dataclass(frozen=True, slots=True)
class GoToPoint:
    primitive_id: int
    north_m: float
    east_m: float
    speed_m_s: float
    victory_radius_m: float


@dataclass(frozen=True, slots=True)
class HoldPosition:
    """Never completes by itself: it succeeds when the next primitive replaces it."""

    primitive_id: int
    north_m: float
    east_m: float


@dataclass(frozen=True, slots=True)
class DockMussel:
    """Take aMussel `agent_id` into dock `dock_index` (0-3), where the vehicle is."""

    primitive_id: int
    dock_index: int
    agent_id: int
    manoeuvre: Manoeuvre = AS_THE_SCENARIO_SAYS


@dataclass(frozen=True, slots=True)
class UndockMussel:
    """Let aMussel `agent_id` go. Where the vehicle has named another slot for it than `dock_index`, its word wins."""

    primitive_id: int
    dock_index: int
    agent_id: int
    manoeuvre: Manoeuvre = AS_THE_SCENARIO_SAYS


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
class DockChanged:
    """A dock closed around an aMussel or opened, asked for or not; all but `closed` is the vehicle's word."""

    at_ms: int
    dock_index: int
    agent_id: int
    closed: bool


Outcome = PrimitiveSucceeded | PrimitiveFailed | DockChanged
