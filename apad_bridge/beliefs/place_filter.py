"""A filter of an aMussel's place: a random walk, and a current that moves it while it is afloat. Mission time.

The state is (north, east, speed north, speed east) in metres and m/s. A current is an Ornstein-Uhlenbeck process: steady
for a while, then different.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from filterpy.kalman import predict, update
from numpy.typing import NDArray

from apad_bridge.beliefs.twin_parameters import WaterParameters

Array = NDArray[np.float64]
_FIX_MATRIX = np.array([[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0]])
_GATE = 25.0


@dataclass(frozen=True, slots=True, eq=False)
class Place:
    mean: Array
    cov: Array

    @classmethod
    def at(cls, north_m: float, east_m: float, variance_m2: float, water: WaterParameters) -> Place:
        speed = water.current_deviation_m_s**2
        return cls(np.array([north_m, east_m, 0.0, 0.0]), np.diag([variance_m2, variance_m2, speed, speed]))

    def propagated(self, water: WaterParameters, elapsed_s: float, afloat: bool) -> Place:
        """The place after `elapsed_s` mission seconds; on the bottom no current moves it, and the current gets unknown."""
        if elapsed_s <= 0:
            return self
        kept, reach, walk, cross, left = _drift(water, elapsed_s, afloat)
        transition = np.array(
            [[1.0, 0.0, reach, 0.0], [0.0, 1.0, 0.0, reach], [0.0, 0.0, kept, 0.0], [0.0, 0.0, 0.0, kept]]
        )
        noise = np.array(
            [
                [walk, 0.0, cross, 0.0],
                [0.0, walk, 0.0, cross],
                [cross, 0.0, left, 0.0],
                [0.0, cross, 0.0, left],
            ]
        )
        mean, cov = predict(self.mean, self.cov, transition, noise)
        return Place(mean, cov)

    def position_after(
        self, water: WaterParameters, elapsed_s: float, afloat: bool
    ) -> tuple[float, float, tuple[float, float, float]]:
        """North, east and their covariance after `elapsed_s`: the same numbers as `propagated`, at a much lower cost."""
        north, east, speed_n, speed_e = self.mean.tolist()
        cov = self.cov.tolist()
        if elapsed_s <= 0:
            return north, east, (cov[0][0], cov[0][1], cov[1][1])
        _, reach, walk, _, _ = _drift(water, elapsed_s, afloat)
        square = reach * reach
        return (
            north + reach * speed_n,
            east + reach * speed_e,
            (
                cov[0][0] + 2 * reach * cov[0][2] + square * cov[2][2] + walk,
                cov[0][1] + reach * (cov[0][3] + cov[1][2]) + square * cov[2][3],
                cov[1][1] + 2 * reach * cov[1][3] + square * cov[3][3] + walk,
            ),
        )

    def corrected_by_fix(
        self, north_m: float, east_m: float, variance_m2: float, water: WaterParameters
    ) -> Place:
        """The place after a fix; a fix five deviations away shows that it was carried off, and replaces the estimate."""
        fix = np.array([north_m, east_m])
        away = fix - self.mean[:2]
        spread = self.cov[:2, :2] + variance_m2 * np.eye(2)
        if float(away @ np.linalg.solve(spread, away)) > _GATE:
            return Place.at(north_m, east_m, variance_m2, water)
        mean, cov = update(self.mean, self.cov, fix, variance_m2 * np.eye(2), _FIX_MATRIX)
        return Place(mean, cov)

    def corrected_by_range(
        self, range_m: float, from_north_m: float, from_east_m: float, variance_m2: float
    ) -> Place:
        """The place after a range, linearised at the estimate; a range too near to its origin has no direction."""
        away = self.mean[:2] - (from_north_m, from_east_m)
        expected = float(np.hypot(*away))
        spread_m2 = float(np.trace(self.cov[:2, :2]))
        if expected < 1e-6:
            return self
        slope = np.array([[away[0] / expected, away[1] / expected, 0.0, 0.0]])
        # The linearisation leaves out the curvature across the line of sight.
        blur = (spread_m2 / (2 * expected)) ** 2
        innovation = np.array([range_m - expected + float((slope @ self.mean)[0])])
        mean, cov = update(self.mean, self.cov, innovation, np.array([[variance_m2 + blur]]), slope)
        return Place(mean, cov)


def _drift(
    water: WaterParameters, elapsed_s: float, afloat: bool
) -> tuple[float, float, float, float, float]:
    """(share of a speed that is kept, its reach in s, variance of the place, covariance with the speed, of the speed).

    Afloat, the place gains the integral of an Ornstein-Uhlenbeck process.
    """
    lasts_s = max(water.current_lasts_s, 1e-3)
    kept = math.exp(-elapsed_s / lasts_s)
    speed = water.current_deviation_m_s**2
    walk, left = water.step_variance_m2 * elapsed_s, speed * (1 - kept * kept)
    if not afloat:
        return kept, 0.0, walk, 0.0, left
    walk += speed * lasts_s * (2 * elapsed_s - lasts_s * (3 - 4 * kept + kept * kept))
    return kept, lasts_s * (1 - kept), walk, speed * lasts_s * (1 - kept) ** 2, left
