"""Frames as ROS's tools expect them (REP 103, REP 105), and the only conversion of NED to ENU.

Our frame is local NED about the scenario's origin: north, east, depth positive down, headings clockwise from north.
ROS's tools draw a world with z up: x east, y north, angles counter-clockwise from east, bodies with x forward and y left.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from apad_bridge.ros_names.names import AMUSSEL, in_full

Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]
"""(x, y, z, w)"""

UPRIGHT: Quaternion = (0.0, 0.0, 0.0, 1.0)
NED_IN_ENU: Quaternion = (math.sqrt(0.5), math.sqrt(0.5), 0.0, 0.0)
"""Half a turn about the axis between x and y exchanges them and turns z over."""


@dataclass(frozen=True, slots=True)
class Frames:
    """The names of a fleet's frames. They begin with its namespace, because a master has one tree of frames."""

    namespace: str = ""
    """Without slashes at its ends."""

    @property
    def enu(self) -> str:
        """The fixed frame of RViz and Foxglove."""
        return self._below("musselbed/enu")

    @property
    def ned(self) -> str:
        """The frame with the same origin, x north, y east, z down: for points in the aPad's own convention."""
        return self._below("musselbed/ned")

    def apad(self, name: str) -> str:
        return self._below(f"{name}/base_link")

    def agent(self, agent_id: int) -> str:
        return self._below(f"{AMUSSEL}{agent_id}/base_link")

    def _below(self, name: str) -> str:
        # TF accepts no name that begins with a slash.
        return in_full(self.namespace, name).removeprefix("/")


def enu(north_m: float, east_m: float, depth_m: float = 0.0) -> Vector:
    """Converts to ENU: metres (x east, y north, z up)."""
    return east_m, north_m, -depth_m


_IN_95 = math.sqrt(-2 * math.log(0.05))
"""The half axis of the ellipse that holds 95 % in two dimensions, in deviations along that axis."""


@dataclass(frozen=True, slots=True)
class Ellipse:
    """The full axes in metres, the longer one first, and the longer axis's rotation from x to y, in ENU."""

    length_m: float
    width_m: float
    attitude: Quaternion


def ellipse_95(variance_m2: Vector) -> Ellipse:
    """Computes the 95 % ellipse of a Gaussian place with the covariance (north, covariance, east)."""
    north, covariance, east = variance_m2
    mean, spread = (north + east) / 2, math.hypot((east - north) / 2, covariance)
    half_turn = math.atan2(2 * covariance, east - north) / 4
    return Ellipse(
        2 * _IN_95 * math.sqrt(mean + spread),
        2 * _IN_95 * math.sqrt(max(0.0, mean - spread)),
        (0.0, 0.0, math.sin(half_turn), math.cos(half_turn)),
    )


def yaw(heading_rad: float) -> Quaternion:
    """Returns the attitude, in ENU, of a level body with this heading, clockwise from north."""
    half = (math.pi / 2 - heading_rad) / 2
    return 0.0, 0.0, math.sin(half), math.cos(half)
