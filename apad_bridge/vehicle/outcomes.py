"""Outcomes of the primitives that a mission orders from a docking port.

Times are integer milliseconds of mission time. An outcome's `primitive_id` repeats the `command_id` that the mission chose.
"""

from __future__ import annotations

from dataclasses import dataclass

from apad_bridge.vehicle.docks import Occupancy


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
