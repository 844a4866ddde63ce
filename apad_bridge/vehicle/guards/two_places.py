"""Finds positions that alternate between two places, as where one topic carries two receivers.

Noise scatters positions about one place, however much. Two places make two clusters that are far apart beside their own
width, and the positions go back and forth between them. The vehicle's steady motion is taken out first.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections import deque
from itertools import pairwise
from operator import mul, sub
from statistics import fmean, pstdev

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
LEAST_IN_A_ROW = 3
"""So many positions in a row have to show them. Of 20, at 1 Hz, noise makes two clusters by chance: the next part them."""
Position = tuple[int, Point]
"""A time (ms) and a place (m)."""


class TwoPlaces:
    """Keeps the newest positions. `take` returns the distance of the two places, 0 for one place."""

    def __init__(self) -> None:
        self._positions: deque[Position] = deque(maxlen=MOST)
        self._in_a_row = 0

    def take(self, at_ms: int, place_m: Point) -> float:
        if self._positions and at_ms <= self._positions[-1][0]:
            return 0.0
        self._positions.append((at_ms, place_m))
        while at_ms - self._positions[0][0] > SPAN_MS:
            self._positions.popleft()
        found_m = apart_m(list(self._positions)) if len(self._positions) >= LEAST_COUNT else 0.0
        self._in_a_row = self._in_a_row + 1 if found_m else 0
        return found_m if self._in_a_row >= LEAST_IN_A_ROW else 0.0

    def forget(self) -> None:
        self._positions.clear()
        self._in_a_row = 0


def apart_m(positions: list[Position]) -> float:
    """The distance of the two places between which the positions alternate; 0 where they do not."""
    along = _along(positions)
    ordered = sorted(along)
    _, cut = max(zip(map(sub, ordered[1:], ordered), ordered, strict=False))
    count = bisect_right(ordered, cut)
    low, high = ordered[:count], ordered[count:]
    if min(len(low), len(high)) < LEAST_CLUSTER or (distance_m := fmean(high) - fmean(low)) < LEAST_M:
        return 0.0
    changes = sum((one > cut) != (other > cut) for one, other in pairwise(along))
    is_apart = changes >= LEAST_CHANGES and distance_m > WIDTHS * max(pstdev(low), pstdev(high))
    return distance_m if is_apart else 0.0


def _along(positions: list[Position]) -> list[float]:
    """The positions without their steady motion, along the direction in which they scatter most."""
    seconds = [(at_ms - positions[0][0]) / 1000 for at_ms, _ in positions]
    north, east = (_without_motion(seconds, [place[axis] for _, place in positions]) for axis in (0, 1))
    nn, ee, ne = (math.fsum(map(mul, *them)) for them in ((north, north), (east, east), (north, east)))
    angle = 0.5 * math.atan2(2 * ne, nn - ee)
    cos, sin = math.cos(angle), math.sin(angle)
    return [a * cos + b * sin for a, b in zip(north, east, strict=True)]


def _without_motion(seconds: list[float], values: list[float]) -> list[float]:
    """The residuals of a line by least squares."""
    mean_s, mean = math.fsum(seconds) / len(seconds), math.fsum(values) / len(values)
    apart_s = [it - mean_s for it in seconds]
    slope = math.fsum(map(mul, apart_s, [it - mean for it in values])) / math.fsum(map(mul, apart_s, apart_s))
    intercept = mean - slope * mean_s
    return [v - intercept - slope * s for s, v in zip(seconds, values, strict=True)]
