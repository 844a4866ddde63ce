"""What the simulated aPad of generation B shows, freed of ROS. Stamps are mission milliseconds."""

from __future__ import annotations

from dataclasses import dataclass

from apad_bridge.ros.legacy_shown import PoseShown
from apad_bridge.vehicle.generation_b.messages import Arm, GoToOrder, Status
from apad_bridge.vehicle.simulated.kinematics import Pose


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


@dataclass(frozen=True, slots=True)
class GoToBegun:
    """Of what lies below the services: whoever ordered, and by whichever road."""

    at_ms: int
    order: GoToOrder


@dataclass(frozen=True, slots=True)
class GoToLeft:
    """What is left of the way: metres, and the direction clockwise from north."""

    at_ms: int
    distance_m: float
    bearing_rad: float


@dataclass(frozen=True, slots=True)
class GoToEnded:
    """DONE, PREEMPTED, or IDLE for one that was aborted."""

    status: Status
    pose: Pose
    left: GoToLeft


Shown = (
    PoseShown
    | BatteryShown
    | StatusShown
    | ArmShown
    | CameraTurned
    | Finished
    | GoToBegun
    | GoToLeft
    | GoToEnded
)
