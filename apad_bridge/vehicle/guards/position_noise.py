"""The noise of a vehicle's position, learned from its samples, at rest and under way.

A step is the distance that noise alone makes between two positions.
"""

from __future__ import annotations

import math
from collections import deque

from apad_bridge.vehicle.commands import PoseReported
from apad_bridge.vehicle.guards.vehicle_clock import span_ms

PLACE_ERROR_M = 0.1
"""The error of the way between two positions of the last two seconds (a GPS, after the vehicle's filter)."""
_NOISE_WEIGHT = 0.05
"""The weight of the newest positions in the mean square of the noise."""
_NEW_NOISES = 4
"""A receiver may become noisy at once: where the mean of so many newest squares is greater, it counts."""
_SPEED_NOISES = 8
"""For the least speed the second greatest of so many newest squares counts: a place that is off makes two or three great
ones, a vehicle that changes its speed one."""
NOISE_SPAN_MS = 4_000
"""Noise is learned from three samples within so long: a vehicle changes its speed in a longer time."""
NOISE_ERRORS = 3.0
"""The error of a way between two positions, in steps of the noise: four deviations along the way."""
ERRORS_95 = 2.45 / 2
"""95 % of the places lie within so many steps of the noise: 2.45 deviations of one coordinate (Rayleigh), of which a step
has two."""
LEAST_REPORTED_M = 0.4
"""A vehicle that starts and turns looks like noise: of 0.3 m (95 %) in a flight of `published-a.yaml`, which has none."""
ERRORS_ABOVE = 1.5
"""Noise is too great from so many times the error that the clearance counts on, and until it falls below that error: some
forty positions tell it, whose mean square differs by a fifth by chance."""


def mean_square(known: float | None, newest: float) -> float:
    before = newest if known is None else known
    return before + _NOISE_WEIGHT * (newest - before)


class PositionNoise:
    """Learns the mean square of the steps. Lengths are in metres."""

    def __init__(self, expected_m: float) -> None:
        """The clearance of the fence counts on positions within `expected_m`, in 95 % of all cases."""
        self._expected_m = expected_m
        self._step_m2: float | None = None
        """The mean square of the steps; None before three samples."""
        self._newest_m2: deque[float] = deque(maxlen=_SPEED_NOISES)
        """The newest squares of it."""
        self.is_too_great = False
        """The noise alone is more than the error that the clearance counts on."""

    @property
    def is_known(self) -> bool:
        return self._step_m2 is not None

    @property
    def step_m(self) -> float:
        """The root mean square of the steps, both directions together."""
        if self._step_m2 is None:
            return 0.0
        newest = list(self._newest_m2)[-_NEW_NOISES:]
        newest_m2 = math.fsum(newest) / len(newest) if len(newest) == _NEW_NOISES else 0.0
        return math.sqrt(max(self._step_m2, newest_m2))

    @property
    def way_error_m(self) -> float:
        """The error of the way between two positions."""
        second_m2 = max(sorted(self._newest_m2)[:-1], default=0.0)
        return max(PLACE_ERROR_M, NOISE_ERRORS * max(self.step_m, math.sqrt(second_m2)))

    @property
    def place_error_m(self) -> float:
        """The error of a place, in 95 % of all cases."""
        return 0.0 if self._step_m2 is None else ERRORS_95 * math.sqrt(self._step_m2)

    def learn(self, one: PoseReported, middle: PoseReported, pose: PoseReported) -> None:
        """Learns from the middle one's distance to the line between its neighbours, which a steady motion leaves out.

        With weights a and b of the neighbours (a + b = 1), the mean square of that distance is 1 + a^2 + b^2 times the
        noise's own, and the mean square of a step is 2 times it.
        """
        if None in (one.stamp_ms, middle.stamp_ms, pose.stamp_ms):
            return  # times of arrival have an error of their own
        whole_ms = span_ms(one, pose)
        if not 0 < whole_ms <= NOISE_SPAN_MS:
            return
        later = span_ms(one, middle) / whole_ms
        north_m = middle.north_m - (1 - later) * one.north_m - later * pose.north_m
        east_m = middle.east_m - (1 - later) * one.east_m - later * pose.east_m
        step_m2 = 2 * (north_m**2 + east_m**2) / (1 + later**2 + (1 - later) ** 2)
        self._step_m2 = mean_square(self._step_m2, step_m2)
        self._newest_m2.append(step_m2)
        expected_m = max(self._expected_m, LEAST_REPORTED_M)
        least_m = expected_m * (1.0 if self.is_too_great else ERRORS_ABOVE)
        self.is_too_great = self.place_error_m > least_m and len(self._newest_m2) == _SPEED_NOISES
