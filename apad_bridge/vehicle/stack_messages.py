"""What is heard from an aPad of either generation, freed of ROS. Stamps are mission milliseconds.

What the simulated aPad of either generation shows, freed of ROS. Stamps are mission milliseconds.
"""

from __future__ import annotations

from dataclasses import dataclass

from apad_bridge.vehicle.simulated.kinematics import Pose


@dataclass(frozen=True, slots=True)
class PoseShown:
    at_ms: int
    pose: Pose


UNSTAMPED = -1
"""Instead of a stamp: whoever empties the inbox knows the time."""


@dataclass(frozen=True, slots=True)
class PoseHeard:
    at_ms: int
    north_m: float
    east_m: float
    heading_rad: float


@dataclass(frozen=True, slots=True)
class StateHeard:
    """`stateRef`: of ours, the word that everything due by its stamp was handled."""

    at_ms: int


@dataclass(frozen=True, slots=True)
class BatteryHeard:
    """Nobody stamps it: `at_ms` is the time of arrival."""

    at_ms: int
    percent: float
