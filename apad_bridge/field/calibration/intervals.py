"""Figures with their intervals of 95 %, by the usual methods of statistics."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy import stats

Floats = npt.NDArray[np.float64]
CONFIDENCE = 0.95


@dataclass(frozen=True, slots=True)
class Figure:
    """A measured figure: its interval holds the true value with 95 %, as far as the method's assumptions hold."""

    value: float
    low: float
    high: float
    samples: int
    unit: str
    method: str

    def scaled(self, factor: float, unit: str) -> Figure:
        return Figure(
            factor * self.value, factor * self.low, factor * self.high, self.samples, unit, self.method
        )


def mean(values: Sequence[float], unit: str, resolution: float = 0.0) -> Figure | None:
    """The mean with Student's t interval (Student 1908, "The probable error of a mean"); None below three values.

    `resolution` is the step of the values' clock or scale: equal values are known to half of it.
    """
    if len(values) < 3:
        return None
    middle = float(np.mean(values))
    half = float(stats.t.ppf(0.5 + CONFIDENCE / 2, len(values) - 1) * stats.sem(values))
    half = max(half, resolution / 2)
    return Figure(middle, middle - half, middle + half, len(values), unit, "t")


def share(count: int, total: int) -> Figure | None:
    """A share with Wilson's score interval (Wilson 1927, "Probable inference"); None of nothing."""
    if total == 0:
        return None
    found = stats.binomtest(count, total).proportion_ci(CONFIDENCE, method="wilson")
    return Figure(count / total, float(found.low), float(found.high), total, "", "Wilson")


def regression(
    inputs: Floats, outputs: Floats, units: Sequence[str], means: int, resolution: float
) -> list[Figure] | None:
    """Least squares of `outputs` (n) on the columns of `inputs` (n x k), through the origin: a figure a column.

    `means` is the number of stretches whose means were subtracted before. The intervals are t intervals with the covariance
    of Newey and West (1987), "A simple, positive semi-definite, heteroskedasticity and autocorrelation consistent
    covariance matrix", of lag 4 (n / 100)^(2/9), and never below those of ordinary least squares, or of outputs that are
    rounded to steps of `resolution`. None below three rows too many, and when the columns cannot be told apart.
    """
    rows, columns = inputs.shape
    free = rows - columns - means
    scale = np.linalg.norm(inputs, axis=0)
    if free < 3 or not scale.all() or np.linalg.cond(inputs / scale) > 1e3:
        return None
    inverse = np.linalg.inv(inputs.T @ inputs)
    slopes = inverse @ inputs.T @ outputs
    scores = inputs * (outputs - inputs @ slopes)[:, None]
    middle = scores.T @ scores
    lags = min(rows - 1, int(4 * (rows / 100) ** (2 / 9)))
    for lag in range(1, lags + 1):
        product = scores[lag:].T @ scores[:-lag]
        middle += (1 - lag / (lags + 1)) * (product + product.T)
    variance = np.diag(inverse @ middle @ inverse) * rows / free
    # The covariance above is too small for few rows: never below that of independent, and of rounded, outputs.
    residuals = outputs - inputs @ slopes
    plain = max(float(residuals @ residuals) / free, resolution**2 / 12) * np.diag(inverse)
    half = stats.t.ppf(0.5 + CONFIDENCE / 2, free) * np.sqrt(np.maximum(variance, plain))
    return [
        Figure(float(slope), float(slope - off), float(slope + off), rows, unit, "least squares, Newey-West")
        for slope, off, unit in zip(slopes, half, units, strict=True)
    ]
