"""Three degrees of freedom on a 100 ms grid: straight to the goal, accelerate, cruise, brake, stay.

The vehicle is omnidirectional (thrusters in X), so it moves towards the goal at any heading, while the bow
turns towards the goal. Speeds change linearly within a step, so positions are trapezoids and exact for the
profile. The numbers are those of the scenario's `apad`; `apad_bridge/scenario/profiles.py` has the paper's.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

STEP_MS = 100
STEP_S = STEP_MS / 1000


@dataclass(frozen=True, slots=True)
class Pose:
    """Local NED metres, radians clockwise from north in (-pi, pi], metres a second over ground."""

    north_m: float
    east_m: float
    heading_rad: float = 0.0
    north_m_s: float = 0.0
    east_m_s: float = 0.0

    @property
    def speed_m_s(self) -> float:
        return math.hypot(self.north_m_s, self.east_m_s)


@dataclass(frozen=True, slots=True)
class Goal:
    north_m: float
    east_m: float
    heading_rad: float
    speed_m_s: float

    def distance_m(self, pose: Pose) -> float:
        return math.hypot(self.north_m - pose.north_m, self.east_m - pose.east_m)

    def is_held_by(self, pose: Pose) -> bool:
        """At rest exactly at the goal: `Motion` lets the last step end there, so equality is correct."""
        return (
            pose.north_m == self.north_m
            and pose.east_m == self.east_m
            and pose.heading_rad == self.heading_rad
            and pose.north_m_s == 0.0
            and pose.east_m_s == 0.0
        )


def braking_speed_m_s(distance_m: float, speed_m_s: float, acceleration_m_s2: float) -> float:
    """The highest speed at the END of a step from which the vehicle still stops within `distance_m`.

    Solves d - (v0 + v1)/2 dt = v1^2 / 2a for v1; on the braking curve it gives v0 - a dt exactly.
    """
    left_m = distance_m - speed_m_s * STEP_S / 2
    root = STEP_S * STEP_S / 4 + 2 * left_m / acceleration_m_s2
    return max(0.0, acceleration_m_s2 * (math.sqrt(max(0.0, root)) - STEP_S / 2))


def wanted_velocity(
    pose: Pose, goal: Goal, distance_m: float, acceleration_m_s2: float
) -> tuple[float, float]:
    """Velocity (north, east) at the end of the step, within the acceleration limit, `distance_m` from the goal.

    It points towards the goal, at the lower of the goal's speed and the braking speed. It has no component
    across that line, so that a vehicle on its way elsewhere turns in.
    """
    if distance_m > 0.0:
        to_north, to_east = (
            (goal.north_m - pose.north_m) / distance_m,
            (goal.east_m - pose.east_m) / distance_m,
        )
    else:
        to_north, to_east = 0.0, 0.0
    along_m_s = pose.north_m_s * to_north + pose.east_m_s * to_east
    speed_m_s = min(goal.speed_m_s, braking_speed_m_s(distance_m, along_m_s, acceleration_m_s2))
    change_north = to_north * speed_m_s - pose.north_m_s
    change_east = to_east * speed_m_s - pose.east_m_s
    change_m_s = math.hypot(change_north, change_east)
    limit_m_s = acceleration_m_s2 * STEP_S
    scale = limit_m_s / change_m_s if change_m_s > limit_m_s else 1.0
    return pose.north_m_s + scale * change_north, pose.east_m_s + scale * change_east


def turned(heading_rad: float, goal_rad: float, yaw_rate_rad_s: float) -> float:
    """The heading one step later, the short way round at no more than `yaw_rate_rad_s`."""
    error_rad = wrapped(goal_rad - heading_rad)
    step_rad = yaw_rate_rad_s * STEP_S
    if abs(error_rad) <= step_rad:
        return goal_rad
    return wrapped(heading_rad + math.copysign(step_rad, error_rad))


def wrapped(angle_rad: float) -> float:
    """The same direction in (-pi, pi]."""
    remainder = math.remainder(angle_rad, math.tau)
    return math.pi if remainder == -math.pi else remainder


def moved(pose: Pose, velocity_m_s: tuple[float, float], heading_rad: float) -> Pose:
    north_m_s, east_m_s = velocity_m_s
    return Pose(
        pose.north_m + (pose.north_m_s + north_m_s) / 2 * STEP_S,
        pose.east_m + (pose.east_m_s + east_m_s) / 2 * STEP_S,
        heading_rad,
        north_m_s,
        east_m_s,
    )
