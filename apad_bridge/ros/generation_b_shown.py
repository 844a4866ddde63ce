"""What the simulated aPad of generation B shows, freed of ROS. Stamps are mission milliseconds."""

from __future__ import annotations

from dataclasses import dataclass

from apad_bridge.ros.generation_b_words import Arm, Status
from apad_bridge.simulated_apad.kinematics import Pose


@dataclass(frozen=True, slots=True)
class PoseShown:
    at_ms: int
    pose: Pose


@dataclass(frozen=True, slots=True)
class BatteryShown:
    at_ms: int
    percent: float


@dataclass(frozen=True, slots=True)
class StatusShown:
    at_ms: int
    docking: bool
    status: Status


@dataclass(frozen=True, slots=True)
class ArmShown:
    at_ms: int
    arm: Arm


@dataclass(frozen=True, slots=True)
class CameraTurned:
    """`kinect_out`: the camera's servo, in [0, 1]."""

    at_ms: int
    servo: float


@dataclass(frozen=True, slots=True)
class Finished:
    """A primitive ended, whichever way."""

    at_ms: int


Shown = PoseShown | BatteryShown | StatusShown | ArmShown | CameraTurned | Finished
