"""Finds a place from ranges by weighted least squares in the plane (Levenberg and Marquardt), with its covariance and HDOP.

An aMussel's depth is known, from its pressure sensor or because it lies on the bottom, so only north and east are found.
With anchors a_i (metres, depth positive down), ranges r_i of variance s_i^2 and a place x at the known depth,

    minimise sum_i ((r_i - |x - a_i|) / s_i)^2,   J_i = (x - a_i)_horizontal / |x - a_i|,   cov(x) = (J^T W J)^-1

and the horizontal dilution of precision is sqrt(trace((J^T J)^-1)), the factor by which a range's error grows.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
_MOST_TRIALS = 200
"""Trials of a place before the iteration is given up; a fix takes about ten."""
_FLAT = 1e-9
"""The least determinant of J^T J with which the geometry gives a fix."""


@dataclass(frozen=True, slots=True)
class PlaceSolution:
    """A place. `covariance` is (north, north-east, east) in square metres, `residuals_m` is in the order of the ranges.

    `chi2` is the weighted sum of squared residuals: with n ranges about n - 2 if their variances are true.
    """

    north_m: float
    east_m: float
    covariance: tuple[float, float, float]
    hdop: float
    residuals_m: tuple[float, ...]
    chi2: float


class NoFix(ValueError):
    """The ranges give no place; the message has the reason."""


def solve(
    anchors_m: Floats, ranges_m: Floats, deviations_m: Floats, depth_m: float, start_m: tuple[float, float]
) -> PlaceSolution:
    """Solves for the place, beginning at `start_m`.

    The anchors are (n, 3: north, east, depth), the ranges (n) and their standard deviations (n). Raises NoFix when the
    geometry gives no fix or the iteration does not converge.
    """
    # Imported here because it takes 0.4 s, and most commands and flights need no fix.
    from scipy.optimize import least_squares

    def weighted_residuals(place: Floats) -> Floats:
        return _linear(place, anchors_m, ranges_m, depth_m)[0] / deviations_m

    def weighted_slopes(place: Floats) -> Floats:
        return -_linear(place, anchors_m, ranges_m, depth_m)[1] / deviations_m[:, None]

    found = least_squares(
        weighted_residuals,
        start_m,
        weighted_slopes,
        method="lm",
        xtol=1e-10,
        ftol=1e-15,
        gtol=1e-15,
        max_nfev=_MOST_TRIALS,
    )
    residuals, slopes = _linear(found.x, anchors_m, ranges_m, depth_m)
    if abs(np.linalg.det(slopes.T @ slopes)) < _FLAT:
        raise NoFix("the anchors and the aMussel lie on a line")
    if not found.success:
        raise NoFix("the iteration does not come to rest")
    return _solution(found.x, residuals, slopes, 1 / deviations_m**2)


def mirrored(anchors_m: Floats, place_m: tuple[float, float]) -> tuple[float, float]:
    """The place mirrored at the line that best fits the anchors. Ranges separate the two places badly."""
    centre = anchors_m[:, :2].mean(axis=0)
    _, _, axes = np.linalg.svd(anchors_m[:, :2] - centre)
    across = axes[1]
    offset = np.array(place_m) - centre
    north, east = centre + offset - 2 * (offset @ across) * across
    return float(north), float(east)


def _linear(place: Floats, anchors_m: Floats, ranges_m: Floats, depth_m: float) -> tuple[Floats, Floats]:
    """Residuals (n) and the horizontal part of the unit vectors from the anchors (n, 2)."""
    vectors = np.column_stack(
        (place[0] - anchors_m[:, 0], place[1] - anchors_m[:, 1], depth_m - anchors_m[:, 2])
    )
    lengths = np.maximum(np.linalg.norm(vectors, axis=1), 1e-9)
    return ranges_m - lengths, vectors[:, :2] / lengths[:, None]


def _solution(place: Floats, residuals: Floats, jacobian: Floats, weights: Floats) -> PlaceSolution:
    covariance = np.linalg.inv(jacobian.T @ (weights[:, None] * jacobian))
    hdop = float(np.sqrt(np.trace(np.linalg.inv(jacobian.T @ jacobian))))
    return PlaceSolution(
        float(place[0]),
        float(place[1]),
        (float(covariance[0, 0]), float(covariance[0, 1]), float(covariance[1, 1])),
        hdop,
        tuple(float(it) for it in residuals),
        float(weights @ residuals**2),
    )
