"""What the simulated aPad of either generation shows, freed of ROS. Stamps are mission milliseconds."""

from __future__ import annotations

from dataclasses import dataclass

from apad_bridge.vehicle.simulated.kinematics import Pose


@dataclass(frozen=True, slots=True)
class PoseShown:
    at_ms: int
    pose: Pose
