"""What a supervisor has learned, and the next one goes on with."""

from __future__ import annotations

from dataclasses import dataclass

from apad_bridge.acoustics.ranging import Ears
from apad_bridge.beliefs.fleet import FleetBeliefs


@dataclass(frozen=True, slots=True)
class Known:
    beliefs: FleetBeliefs
    ears: Ears | None
    """None without water, or without a modem in it."""
