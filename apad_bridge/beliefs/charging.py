"""A docked battery of uncertain charge, carried forward along the paper's charging curve (equation (2))."""

from __future__ import annotations

import math

from apad_bridge.beliefs.knowledge import Charger

_NODES = (-2.8569700138728, -1.3556261799743, 0.0, 1.3556261799743, 2.8569700138728)
_WEIGHTS = (0.011257411327721, 0.222075922005613, 8 / 15, 0.222075922005613, 0.011257411327721)
"""Gauss and Hermite's five points for a standard normal variable."""


def charged(charger: Charger, coils: float, load_per_min: float, charge: float, minutes: float) -> float:
    """From `charge`, after `minutes` under `coils` coils and a load that counts against them; at most 1."""
    charge = max(0.0, charge)
    for end, rate in charger.segments:
        if charge >= end:
            continue
        net = coils * rate - load_per_min
        if net <= 0:
            return max(0.0, charge + net * minutes)
        needs = (end - charge) / net
        if needs >= minutes:
            return charge + net * minutes
        charge, minutes = end, minutes - needs
    return 1.0


def carried(
    charger: Charger, coils: float, load_per_min: float, mean: float, variance: float, minutes: float
) -> tuple[float, float, float]:
    """Mean and variance after `minutes`, and the regression of the new charge on the old one.

    By five points of the old charge; what lies beyond 0 or 1 rests there. How well the coils came to lie adds to the
    variance in proportion to what was gained.
    """
    sd = math.sqrt(max(variance, 0.0))
    if sd < 1e-6:
        new = charged(charger, coils, load_per_min, mean, minutes)
        gained = new - min(1.0, max(0.0, mean))
        slope = 0.0 if new >= 1 else 1.0
        return new, _coupling(charger, coils, load_per_min, mean, minutes, new, gained), slope
    first = second = cross = 0.0
    for node, weight in zip(_NODES, _WEIGHTS, strict=True):
        new = charged(charger, coils, load_per_min, min(1.0, mean + sd * node), minutes)
        first += weight * new
        second += weight * new * new
        cross += weight * node * new
    middle = charged(charger, coils, load_per_min, min(1.0, mean), minutes)
    gained = middle - min(1.0, max(0.0, mean))
    extra = _coupling(charger, coils, load_per_min, mean, minutes, middle, gained)
    return first, max(0.0, second - first * first) + extra, cross / sd


def _coupling(
    charger: Charger,
    coils: float,
    load_per_min: float,
    mean: float,
    minutes: float,
    reached: float,
    gained: float,
) -> float:
    """Variance from the coils: by how much one deviation less would have charged less."""
    if gained <= 0:
        return 0.0
    less = charged(charger, coils * (1 - charger.deviation), load_per_min, mean, minutes)
    return (reached - less) ** 2
