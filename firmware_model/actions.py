"""What the board does to the world, in the imperative. `at_ms` is agent time."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

from firmware_model.states import State, Trigger


class Buoyancy(IntEnum):
    """What the buoyancy motors were last run to."""

    SINK = 0
    FLOAT = 1


@dataclass(frozen=True, slots=True)
class StateChanged:
    at_ms: int
    old: State
    trigger: Trigger
    new: State


@dataclass(frozen=True, slots=True)
class RunBuoyancy:
    at_ms: int
    to: Buoyancy


@dataclass(frozen=True, slots=True)
class Dropped:
    """A stimulus that the board could not use; counted by whoever hosts it, never raised."""

    at_ms: int
    reason: str


Action = StateChanged | RunBuoyancy | Dropped
