"""What a supervisor has learned, and the next one goes on with."""

from __future__ import annotations

from dataclasses import dataclass

from apad_bridge.beliefs.fleet import FleetBeliefs
from apad_bridge.talking.ears import Ears


@dataclass(frozen=True, slots=True)
class Known:
    beliefs: FleetBeliefs
    ears: Ears | None
    """None without water, or without a modem in it."""
