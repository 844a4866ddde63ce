"""The aPad's camera: a pinhole that looks down beside the hull at a floating simulated aMussel.

Image coordinates are 0 in the middle and 1 at an edge: `horizontal` to the right, `vertical` down, so that a
nearer aMussel appears lower. The camera's place is assumed; the numbers are chosen so that an aMussel at the
docking distance of 0.4 m appears at 0.85, in the middle of the interval (0.8, 0.9) in which the field's
docking ends.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

HEIGHT_M = 0.5
PITCH_RAD = math.radians(29.7)
HALF_WIDTH_RAD = math.radians(31.0)
HALF_HEIGHT_RAD = math.radians(25.0)
AMUSSEL_M = 0.15
"""Width of an aMussel's cap: assumed."""


@dataclass(frozen=True, slots=True)
class CameraSighting:
    horizontal: float
    vertical: float
    size: float
    """Width in the image, as a part of the whole."""


def seen(
    place_m: tuple[float, float], heading_rad: float, direction_rad: float, target_m: tuple[float, float]
) -> CameraSighting | None:
    """The image of an aMussel at `target_m` from an aPad at `place_m`, both (north, east).

    The camera is turned `direction_rad` from the bow. None outside the image, which ends some six metres
    away.
    """
    north_m, east_m = target_m[0] - place_m[0], target_m[1] - place_m[1]
    bearing_rad = heading_rad + direction_rad
    ahead_m = north_m * math.cos(bearing_rad) + east_m * math.sin(bearing_rad)
    right_m = east_m * math.cos(bearing_rad) - north_m * math.sin(bearing_rad)
    depth_m = ahead_m * math.cos(PITCH_RAD) + HEIGHT_M * math.sin(PITCH_RAD)
    down_m = HEIGHT_M * math.cos(PITCH_RAD) - ahead_m * math.sin(PITCH_RAD)
    if depth_m <= 0:
        return None
    horizontal = right_m / depth_m / math.tan(HALF_WIDTH_RAD)
    vertical = down_m / depth_m / math.tan(HALF_HEIGHT_RAD)
    if abs(horizontal) > 1 or abs(vertical) > 1:
        return None
    return CameraSighting(horizontal, vertical, AMUSSEL_M / (2 * depth_m * math.tan(HALF_WIDTH_RAD)))
