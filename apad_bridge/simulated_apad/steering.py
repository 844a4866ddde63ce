"""What the manners of a stack tell the simulated aPad beyond the port's commands: its controllers off, or a body velocity.

Neither has an id and neither ever ends by itself; a later go-to or hold replaces them, as they replace it.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Coast:
    """Controllers off: drag stops what moves, and the water carries the vehicle along."""


@dataclass(frozen=True, slots=True)
class Steer:
    """Keep to a velocity: `speed_m_s` towards `direction_rad` clockwise from the bow, turning at `yaw_rate_rad_s`."""

    speed_m_s: float
    direction_rad: float
    yaw_rate_rad_s: float
