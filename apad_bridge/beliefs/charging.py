"""Propagates the uncertain charge of a docked battery along the paper's charging curve (equation (2))."""

from __future__ import annotations

import math
from typing import NamedTuple

from apad_bridge.beliefs.twin_parameters import ChargerParameters

_NODES = (-2.8569700138728, -1.3556261799743, 0.0, 1.3556261799743, 2.8569700138728)
_RATE_STEP = 0.01
_WEIGHTS = (0.011257411327721, 0.222075922005613, 8 / 15, 0.222075922005613, 0.011257411327721)
"""The five points and weights of Gauss-Hermite quadrature for a standard normal variable."""


def charged(
    charger: ChargerParameters, coils: float, load_per_min: float, charge: float, minutes: float
) -> float:
    """The charge after `minutes`, from `charge`, under `coils` coils and a load that counts against them.

    The result is not clamped at 1: the curve goes on as if there were room, so that the uncertainty lasts until the charge
    is clamped.
    """
    charge = max(0.0, charge)
    for end, rate in charger.segments:
        net = coils * rate - load_per_min
        if charge >= end and end < 1:
            continue
        if net <= 0:
            return max(0.0, charge + net * minutes)
        needs = (end - charge) / net
        if needs >= minutes or end >= 1:
            return charge + net * minutes
        charge, minutes = end, minutes - needs
    raise AssertionError("the last segment ends at 1")


class Rate(NamedTuple):
    """A charging rate relative to the nominal one, and its covariance with the charge."""

    mean: float
    variance: float
    covariance: float


NOMINAL = Rate(1.0, 0.0, 0.0)


class Charged(NamedTuple):
    """A charge after a time in a dock, not clamped at 1."""

    mean: float
    variance: float
    slope: float
    """The regression slope of the new charge on the old one."""
    by_rate: float
    """The slope of the new charge on the relative charging rate."""


def propagated(
    charger: ChargerParameters,
    coils: float,
    load_per_min: float,
    mean: float,
    variance: float,
    minutes: float,
    rate: Rate = NOMINAL,
) -> Charged:
    """The charge after `minutes`, from `mean` and `variance` before.

    The moments are computed from five quadrature points of the old charge. Two things add to the variance: the alignment
    of the coils, by the square of the charge that a rate of one deviation less would lose; and the uncertain rate.
    """
    coils *= rate.mean
    sd = math.sqrt(max(variance, 0.0))
    middle = charged(charger, coils, load_per_min, mean, minutes)
    less = charged(charger, coils * (1 - _RATE_STEP), load_per_min, mean, minutes)
    by_rate = (middle - less) / _RATE_STEP / rate.mean
    extra = by_rate**2 * ((charger.deviation * rate.mean) ** 2 + rate.variance)
    if sd < 1e-6:
        return Charged(middle, extra, 1.0, by_rate)
    first = second = cross = 0.0
    for node, weight in zip(_NODES, _WEIGHTS, strict=True):
        new = charged(charger, coils, load_per_min, min(1.0, mean + sd * node), minutes)
        first += weight * new
        second += weight * new * new
        cross += weight * node * new
    slope = cross / sd
    variance = second - first * first + extra + 2 * slope * by_rate * rate.covariance
    return Charged(first, max(0.0, variance), slope, by_rate)
