"""A charge as a mixture of Gaussians that is clamped to [0, 1], as a battery is: probability beyond an end lies on it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from statistics import NormalDist
from typing import NamedTuple

_ROOT_TWO = math.sqrt(2)
_STANDARD = NormalDist()
_NEAR = 1e-9


class Gaussian(NamedTuple):
    """A Gaussian of weight `weight`, before clamping; a deviation of 0 is a certain value."""

    weight: float
    mean: float
    sd: float


def normal_cdf(z: float) -> float:
    return 0.5 * math.erfc(-z / _ROOT_TWO)


def normal_pdf(z: float) -> float:
    return math.exp(-0.5 * z * z) / math.sqrt(2 * math.pi)


def below(parts: Sequence[Gaussian], charge: float) -> float:
    """The probability of `charge` or less."""
    if charge < 0:
        return 0.0
    if charge >= 1:
        return 1.0
    # Weights may sum to a rounding error above 1, and callers take roots of 1 - probability.
    return min(1.0, math.fsum(weight * _cdf(charge, mean, sd) for weight, mean, sd in parts))


def below_strictly(parts: Sequence[Gaussian], charge: float) -> float:
    """The probability of less than `charge`; at 1, that excludes the probability clamped to 1."""
    if charge <= 0:
        return 0.0
    if charge > 1:
        return 1.0
    return min(1.0, math.fsum(weight * _cdf(charge, mean, sd, strictly=True) for weight, mean, sd in parts))


def interval(parts: Sequence[Gaussian], share: float) -> tuple[float, float]:
    """The central interval of probability `share`."""
    return quantile(parts, (1 - share) / 2), quantile(parts, (1 + share) / 2)


def quantile(parts: Sequence[Gaussian], probability: float) -> float:
    """The least charge that is not exceeded with `probability`: exact for one Gaussian, bisected to 1e-9 for several."""
    z = _STANDARD.inv_cdf(probability)
    # The quantile of the mixture lies between the clamped quantiles of its parts.
    own = [min(1.0, max(0.0, mean + z * sd)) for _, mean, sd in parts]
    low, high = min(own), max(own)
    if below(parts, low) >= probability:
        return low
    while high - low > _NEAR:
        middle = (low + high) / 2
        if below(parts, middle) >= probability:
            high = middle
        else:
            low = middle
    return high


def inside(mean: float, variance: float) -> float:
    """The probability of a Gaussian between 0 and 1."""
    sd = math.sqrt(max(variance, 0.0))
    return float(0 <= mean <= 1) if sd < 1e-9 else normal_cdf((1 - mean) / sd) - normal_cdf(-mean / sd)


def clamped(mean: float, variance: float) -> tuple[float, float]:
    """Mean and variance of a Gaussian whose values beyond 0 or 1 are moved to that end.

    A battery that runs empty or full behaves like this, so it belongs to prediction: the ends keep their probability.
    """
    sd = math.sqrt(max(variance, 0.0))
    if mean - 5 * sd >= 0 and mean + 5 * sd <= 1:
        return mean, variance
    if sd < 1e-9:
        return min(1.0, max(0.0, mean)), 0.0
    a, b = -mean / sd, (1 - mean) / sd
    cdf_a, cdf_b, pdf_a, pdf_b = normal_cdf(a), normal_cdf(b), normal_pdf(a), normal_pdf(b)
    between = cdf_b - cdf_a
    first = mean * between + sd * (pdf_a - pdf_b) + (1 - cdf_b)
    second = (mean**2 + variance) * between + sd * (2 * mean * (pdf_a - pdf_b) + sd * (a * pdf_a - b * pdf_b))
    second += 1 - cdf_b
    # Far outside, `first` is only rounding.
    return min(1.0, max(0.0, first)), max(0.0, second - first**2)


def truncated(mean: float, variance: float) -> tuple[float, float]:
    """Mean and variance of a Gaussian that is truncated to [0, 1].

    It belongs to measurements, because a posterior beyond an end is no charge. Far outside, the result is the end itself.
    """
    sd = math.sqrt(max(variance, 0.0))
    if mean - 5 * sd >= 0 and mean + 5 * sd <= 1:
        return mean, variance
    if sd < 1e-9:
        return min(1.0, max(0.0, mean)), 0.0
    a, b = -mean / sd, (1 - mean) / sd
    between = normal_cdf(b) - normal_cdf(a)
    if between < 1e-6:
        return min(1.0, max(0.0, mean)), min(variance, (sd / max(abs(a), abs(b), 1.0)) ** 2)
    pdf_a, pdf_b = normal_pdf(a), normal_pdf(b)
    shift = (pdf_a - pdf_b) / between
    spread = 1 + (a * pdf_a - b * pdf_b) / between - shift**2
    return min(1.0, max(0.0, mean + sd * shift)), variance * max(spread, 1e-9)


def _cdf(charge: float, mean: float, sd: float, strictly: bool = False) -> float:
    if sd < 1e-9:
        return float(mean < charge if strictly else mean <= charge)
    return normal_cdf((charge - mean) / sd)
