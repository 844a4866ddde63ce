"""The continuous ranked probability score (CRPS) of a charge that is believed to be a mixture of Gaussians in [0, 1].

It is the integral of (F(x) - 1{x >= y})^2, for the belief's distribution F and the true charge y. A certain belief has its
absolute error. In the mean no distribution has a lower score than the one from which the truth is drawn.

Gneiting et al. (2005, Monthly Weather Review 133, p. 1098) have the closed form for a Gaussian, and Grimit et al. (2006,
Quarterly Journal of the Royal Meteorological Society 132, p. 2925) for a mixture, both over all x. A battery holds its
charge in [0, 1]: the same integrals there need Owen's function T besides, for each pair of Gaussians.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from apad_bridge.beliefs.mixture import Gaussian, normal_cdf, normal_pdf

_LEAST_SD = 1e-7
"""A certain charge counts as one of this deviation, far below what a record resolves."""


def crps(parts: Sequence[Gaussian], true: float) -> float:
    """The score on the scale of the charge, 0 for a certain belief that is right; `true` lies in [0, 1]."""
    its = [Gaussian(weight, mean, max(sd, _LEAST_SD)) for weight, mean, sd in parts]
    above = _integral(its, 1.0) - _integral(its, true)
    return max(0.0, _integral_of_square(its, 1.0) - _integral_of_square(its, 0.0) + 1 - true - 2 * above)


def _integral(parts: list[Gaussian], end: float) -> float:
    """The integral of F, without ends, up to `end`."""
    found = 0.0
    for weight, mean, sd in parts:
        z = (end - mean) / sd
        found += weight * sd * (z * normal_cdf(z) + normal_pdf(z))
    return found


def _integral_of_square(parts: list[Gaussian], end: float) -> float:
    """The integral of F^2, without ends, up to `end`: the mean of how far the higher of two draws lies below it."""
    below = math.fsum(weight * normal_cdf((end - mean) / sd) for weight, mean, sd in parts)
    return end * below**2 - 2 * math.fsum(
        first.weight * second.weight * _mean_of_higher(first, second, end)
        for first in parts
        for second in parts
    )


def _mean_of_higher(first: Gaussian, second: Gaussian, end: float) -> float:
    """The mean of a draw of `first`, where one of `second` is lower and `end` higher; 0 elsewhere. By Stein's lemma."""
    spread = math.hypot(first.sd, second.sd)
    both = (first.mean * second.sd**2 + second.mean * first.sd**2) / spread**2
    alike = normal_pdf((first.mean - second.mean) / spread) / spread
    alike *= normal_cdf((end - both) * spread / (first.sd * second.sd))
    z = (end - first.mean) / first.sd
    at_end = normal_pdf(z) / first.sd * normal_cdf((end - second.mean) / second.sd)
    return first.mean * _ordered(first, second, z) + first.sd**2 * (alike - at_end)


def _ordered(first: Gaussian, second: Gaussian, z: float) -> float:
    """The probability that a draw of `second` is lower than one of `first`, which is at most `z` deviations high.

    By Owen (1956, Annals of Mathematical Statistics 27, p. 1075).
    """
    if first == second:
        return normal_cdf(z) ** 2 / 2
    # Imported here, because scipy takes a while, and few commands need it.
    from scipy.special import owens_t

    spread = math.hypot(first.sd, second.sd)
    # The formula divides by both. So near to 0 the probability is the same.
    higher, z = (math.copysign(max(abs(it), 1e-20), it) for it in ((first.mean - second.mean) / spread, z))
    slope = first.sd / second.sd
    return float(
        (normal_cdf(z) + normal_cdf(higher)) / 2
        - owens_t(z, higher * spread / (z * second.sd) + slope)
        - owens_t(higher, z * spread / (higher * second.sd) + slope)
        - (z * higher < 0) / 2
    )
