"""Four thrusters in X: a plane force becomes four saturated thrusts, and these electrical power.

Order: front left, front right, rear left, rear right. Each stands at 45 degrees to the bow and pushes both ways. The model
neglects the turning moment (the bow turns for free, at a limited rate), the waves and the mutual wash.
"""

from __future__ import annotations

import math

Forces = tuple[float, float, float, float]
NO_FORCES: Forces = (0.0, 0.0, 0.0, 0.0)
_HALF_DIAGONAL = 1 / (2 * math.sqrt(2))


def allocate(
    force_north_n: float, force_east_n: float, heading_rad: float, max_n: float
) -> tuple[Forces, float]:
    """The thrusts for a force, and the fraction of that force in (0, 1] that they give.

    The minimum-norm solution f_i = (F . d_i) / 2 for unit directions d_i, scaled as a whole when one thrust
    would exceed `max_n`, so that the force keeps its direction.
    """
    bow_north, bow_east = math.cos(heading_rad), math.sin(heading_rad)
    surge_n = force_north_n * bow_north + force_east_n * bow_east
    sway_n = force_east_n * bow_north - force_north_n * bow_east
    one = (surge_n + sway_n) * _HALF_DIAGONAL
    other = (surge_n - sway_n) * _HALF_DIAGONAL
    largest = max(abs(one), abs(other))
    fraction = max_n / largest if largest > max_n else 1.0
    one, other = one * fraction, other * fraction
    return (one, other, other, one), fraction


def electrical_w(forces: Forces, w_per_n: float) -> float:
    return w_per_n * math.fsum(map(abs, forces))
