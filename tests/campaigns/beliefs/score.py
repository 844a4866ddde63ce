"""Scores beliefs: error, coverage of the 95 % interval, and consistency, by the age of the last packet."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from apad_bridge.beliefs.mixture import Gaussian, below
from beliefs.truth import Array

AGES = (
    ("now", 0, 0),
    ("1-6", 1, 6),
    ("7-12", 7, 12),
    ("13-24", 13, 24),
    ("25-48", 25, 48),
    ("49-", 49, 1 << 30),
)
COLUMNS = ("age_h", "truth", "mean", "variance", "low", "high", "right", "ends")
"""The columns of a row: age of the last packet, true and believed charge, variance, the probability of at most the true
charge and of less, 1 if the mode is right, and the part of the belief at exactly 0 or 1."""


_BREAKS = (-6.0, -3.0, -1.0, 0.0, 1.0, 3.0, 6.0)
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(4)


def crps(parts: Sequence[Gaussian], charge: float) -> float:
    """The continuous ranked probability score at the true `charge`: the integral of (cdf - step at it)^2 over [0, 1].

    It is 0 for a certain true belief, and else on the scale of the charge. Gauss and Legendre's rule, between points at
    which the integrand is smooth: exact to some 1e-5 of the widest deviation.
    """
    at = {0.0, 1.0, charge}
    for _, mean, sd in parts:
        at.update(min(1.0, max(0.0, mean + z * sd)) for z in _BREAKS)
    total = 0.0
    for low, high in pairwise(sorted(at)):
        half, step = (high - low) / 2, float(low >= charge)
        for node, weight in zip(_NODES, _WEIGHTS, strict=True):
            total += float(weight) * half * (below(parts, low + half * (1 + float(node))) - step) ** 2
    return total


def score(rows: Array, certain: bool = False) -> dict[str, Any]:
    """Scores rows as in `COLUMNS`. A filter that claims to be `certain` has neither coverage nor consistency."""
    age, truth, mean, variance, low, high, right, ends = rows.T
    error = mean - truth
    bins = {name: (age >= first) & (age <= last) for name, first, last in AGES}
    found: dict[str, Any] = {
        "rmse": _root(error),
        "coverage": None,
        "nees": None,
        "coverage_by_age": None,
        "samples_by_age": {name: int(here.sum()) for name, here in bins.items()},
        "rmse_by_age": {name: _root(error[here]) for name, here in bins.items()},
        "mode_share": float(right.mean()),
        "samples": len(rows),
    }
    if certain:
        return found
    covered = (low >= 0.025) & (high <= 0.975)
    # Clamped: the truth, or more than half of the belief, is exactly 0 or 1.
    clamped = (truth <= 0) | (truth >= 1) | (ends > 0.5) | (variance <= 0)
    square = np.where(clamped, 0.0, error**2 / np.maximum(variance, 1e-12))
    found |= {
        "coverage": _share(covered),
        "coverage_clamped": _share(covered[clamped]),
        "clamped": float(clamped.mean()),
        "nees": _share(square[~clamped]),
        "coverage_by_age": {name: _share(covered[here]) for name, here in bins.items()},
        "nees_by_age": {name: _share(square[here & ~clamped]) for name, here in bins.items()},
    }
    return found


def _share(of: Array) -> float | None:
    return float(of.mean()) if len(of) else None


def _root(error: Array) -> float | None:
    return float(np.sqrt(np.mean(error**2))) if len(error) else None
