"""The statistics of a study: means with confidence intervals, paired differences, Holm's adjustment, and a ranking.

All intervals are Student's t over the seeds. Strategies fly the same configurations, so an interval of a difference is
over the differences seed by seed. p-values are two-sided paired t-tests. The study's primary column is tested as it is; the
p-values of all other columns of a pair are adjusted by Holm's step-down method.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from apad_bridge.studies.mission_figures import COLUMNS
from apad_bridge.studies.runner import Row


@dataclass(frozen=True, slots=True)
class Estimate:
    """A mean over `count` seeds, and the ends of its confidence interval; the ends are NaN for fewer than two seeds."""

    count: int
    mean: float
    low: float
    high: float


@dataclass(frozen=True, slots=True)
class Difference:
    """A strategy minus the baseline, seed by seed."""

    estimate: Estimate
    p: float
    """The p-value: the primary column's as it is, of the others adjusted by Holm; NaN for fewer than two seeds."""


@dataclass(frozen=True, slots=True)
class Standing:
    """A strategy in one setting."""

    strategy: str
    columns: dict[str, Estimate | None]
    """By column; None where no mission has the figure."""
    differences: dict[str, Difference | None]
    """By column, to the baseline; empty for the baseline itself."""


def standings(
    rows: Sequence[Row], strategies: Sequence[str], baseline: str, primary: str, confidence: float
) -> list[Standing]:
    """The strategies of one setting, best first: by mean aMussels lost, then samples, then metres."""
    by_strategy: dict[str, dict[int, Row]] = {name: {} for name in strategies}
    for row in rows:
        by_strategy[row["strategy"]][row["seed"]] = row
    found = []
    for name in strategies:
        columns = {
            column: estimate_of([row[column] for row in by_strategy[name].values()], confidence)
            for column in COLUMNS
        }
        differences = (
            {}
            if name == baseline
            else _differences(by_strategy[name], by_strategy[baseline], primary, confidence)
        )
        found.append(Standing(name, columns, differences))
    return sorted(found, key=_rank)


def _rank(standing: Standing) -> tuple[float, float, float]:
    lost, samples, metres = (standing.columns[it] for it in ("amussels_lost", "samples_taken", "metres"))
    assert lost is not None and samples is not None and metres is not None  # every mission has these
    return lost.mean, -samples.mean, metres.mean


def _differences(
    ours: Mapping[int, Row], theirs: Mapping[int, Row], primary: str, confidence: float
) -> dict[str, Difference | None]:
    found = {column: difference_of(ours, theirs, column, confidence) for column in COLUMNS}
    secondary = [it for it in COLUMNS if it != primary]
    return {**found, **dict(zip(secondary, holm_adjusted([found[it] for it in secondary]), strict=True))}


def difference_of(
    ours: Mapping[int, Row], theirs: Mapping[int, Row], column: str, confidence: float
) -> Difference | None:
    """Our rows minus theirs, seed by seed, with the p-value as it is; None where no pair has the figure."""
    values = [
        ours[seed][column] - theirs[seed][column]
        for seed in ours
        if seed in theirs and ours[seed][column] is not None and theirs[seed][column] is not None
    ]
    estimate = estimate_of(values, confidence)
    return None if estimate is None else Difference(estimate, _p_of(values))


def holm_adjusted(found: Sequence[Difference | None]) -> list[Difference | None]:
    """The differences with their p-values adjusted by Holm, as those of one family."""
    adjusted = iter(holm([it.p for it in found if it is not None]))
    return [None if it is None else Difference(it.estimate, next(adjusted)) for it in found]


def estimate_of(values: Sequence[float | None], confidence: float) -> Estimate | None:
    """The mean of the values that are known, with Student's t interval; None if none is."""
    known = np.array([value for value in values if value is not None], dtype=float)
    if not len(known):
        return None
    mean = float(known.mean())
    if len(known) < 2:
        return Estimate(len(known), mean, math.nan, math.nan)
    half = _t_quantile(confidence, len(known) - 1) * float(known.std(ddof=1)) / math.sqrt(len(known))
    return Estimate(len(known), mean, mean - half, mean + half)


def _t_quantile(confidence: float, freedom: int) -> float:
    # Imported here, because scipy's distributions take a second.
    from scipy.stats import t

    return float(t.ppf(0.5 + confidence / 2, freedom))


def _p_of(differences: Sequence[float]) -> float:
    """The two-sided p of a mean of 0. Differences that are all equal have no spread: 1 if they are 0, else 0."""
    values = np.array(differences, dtype=float)
    if len(values) < 2:
        return math.nan
    spread = float(values.std(ddof=1))
    if spread == 0.0:
        return 1.0 if values[0] == 0 else 0.0
    from scipy.stats import t

    return float(2 * t.sf(abs(float(values.mean())) / (spread / math.sqrt(len(values))), len(values) - 1))


def holm(p_values: Sequence[float]) -> list[float]:
    """Holm's adjusted p-values (S. Holm, 1979), in the order given: max over j <= i of (m - j + 1) p_(j), at most 1."""
    order = sorted(range(len(p_values)), key=lambda index: p_values[index])
    adjusted, highest = [0.0] * len(p_values), 0.0
    for rank, index in enumerate(order):
        highest = max(highest, min(1.0, (len(p_values) - rank) * p_values[index]))
        adjusted[index] = highest
    return adjusted
