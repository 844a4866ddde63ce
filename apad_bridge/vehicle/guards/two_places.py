"""Finds positions that alternate between two places, as where one topic carries two receivers.

Noise scatters positions about one place, however much. Two places make two clusters that are far apart beside their own
width, and the positions go back and forth between them. The vehicle's steady motion is taken out first.
"""

from __future__ import annotations

import math
from collections import deque
from itertools import pairwise
from statistics import fmean, linear_regression, pstdev

from apad_bridge.vehicle.guards.guarded_orders import Point

SPAN_MS = 20_000
MOST = 60
"""Positions are kept for so long, and no more of them than so many: at 10 Hz, of 6 s."""
LEAST_COUNT = 20
LEAST_CLUSTER = 5
"""Fewer positions of noise alone make two clusters by chance."""
LEAST_CHANGES = 3
"""One jump changes the place once, and a vehicle that turns comes back once."""
LEAST_M = 1.0
WIDTHS = 6.0
"""Two clusters lie so many of their deviations apart. Noise cut in two has 2.7, the motion of waves 4.1."""
Position = tuple[int, Point]
"""A time (ms) and a place (m)."""


class TwoPlaces:
    """Keeps the newest positions. `take` returns the distance of the two places, 0 for one place."""

    def __init__(self) -> None:
        self._positions: deque[Position] = deque(maxlen=MOST)

    def take(self, at_ms: int, place_m: Point) -> float:
        if self._positions and at_ms <= self._positions[-1][0]:
            return 0.0
        self._positions.append((at_ms, place_m))
        while at_ms - self._positions[0][0] > SPAN_MS:
            self._positions.popleft()
        return apart_m(list(self._positions)) if len(self._positions) >= LEAST_COUNT else 0.0

    def forget(self) -> None:
        self._positions.clear()


def apart_m(positions: list[Position]) -> float:
    """The distance of the two places between which the positions alternate; 0 where they do not."""
    along = _along(positions)
    ordered = sorted(along)
    _, cut = max(
        ((after - before, (after + before) / 2) for before, after in pairwise(ordered)), default=(0.0, 0.0)
    )
    low, high = [it for it in along if it <= cut], [it for it in along if it > cut]
    if min(len(low), len(high)) < LEAST_CLUSTER:
        return 0.0
    changes = sum((one > cut) != (other > cut) for one, other in pairwise(along))
    distance_m = fmean(high) - fmean(low)
    width_m = max(pstdev(low), pstdev(high))
    is_apart = distance_m >= LEAST_M and distance_m > WIDTHS * width_m
    return distance_m if is_apart and changes >= LEAST_CHANGES else 0.0


def _along(positions: list[Position]) -> list[float]:
    """The positions without their steady motion, along the direction in which they scatter most."""
    seconds = [(at_ms - positions[0][0]) / 1000 for at_ms, _ in positions]
    north, east = (_without_motion(seconds, [place[axis] for _, place in positions]) for axis in (0, 1))
    nn, ee = (math.fsum(it * it for it in one) for one in (north, east))
    ne = math.fsum(a * b for a, b in zip(north, east, strict=True))
    angle = 0.5 * math.atan2(2 * ne, nn - ee)
    return [a * math.cos(angle) + b * math.sin(angle) for a, b in zip(north, east, strict=True)]


def _without_motion(seconds: list[float], values: list[float]) -> list[float]:
    """The residuals of a line by least squares."""
    slope, intercept = linear_regression(seconds, values)
    return [v - intercept - slope * s for s, v in zip(seconds, values, strict=True)]
