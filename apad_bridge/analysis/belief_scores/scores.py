"""Scores beliefs: error, coverage and consistency by the age of the last packet, by mode and by aMussel."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import asdict, dataclass
from typing import Any

from apad_bridge.analysis.belief_scores.comparisons import Comparison

AGES_H = ((1 / 60, "a minute"), (1.0, "1 h"), (6.0, "6 h"), (12.0, "12 h"), (24.0, "24 h"), (48.0, "48 h"))
"""The bins' upper ends, in agent time, and names; older samples have a bin of their own."""
OLDER = "older"
_CERTAIN = 1e-9
_ELLIPSE_95 = -2 * math.log(0.05)
"""The squared deviation in two dimensions below which 95 % lie."""


@dataclass(frozen=True, slots=True)
class Score:
    """The scores of one bin. None without an interval, or if every charge rests at 0 or 1."""

    samples: int
    rmse: float
    bias: float
    coverage: float | None
    """The share of samples in the interval of 95 %."""
    nees: float | None
    """The mean square of the error in deviations, without charges that rest at 0 or 1; it is 1 for consistent beliefs."""
    mode_right: float
    place_rmse_m: float | None
    place_coverage: float | None
    """The share of places in the believed ellipse of 95 %. This and `place_nees` are None without deviations of places."""
    place_nees: float | None
    """The same as `nees` for both axes of the place, divided by two."""


@dataclass(frozen=True, slots=True)
class Scores:
    overall: Score
    by_age: dict[str, Score]
    by_mode: dict[str, Score]
    by_agent: dict[str, Score]

    def to_json(self) -> dict[str, Any]:
        return asdict(self)


def scores_of(rows: Iterable[Comparison]) -> Scores | None:
    """The scores of all comparisons; None when there are none."""
    comparisons = list(rows)
    if not comparisons:
        return None
    names = [name for _, name in AGES_H] + [OLDER]
    return Scores(
        _score(comparisons),
        _by(comparisons, lambda row: age_bin(row.age_h), names.index),
        _by(comparisons, lambda row: row.mode.name.lower().replace("_", " "), str),
        _by(comparisons, lambda row: str(row.agent_id), int),
    )


def age_bin(age_h: float) -> str:
    return next((name for end, name in AGES_H if age_h <= end), OLDER)


def _by(
    rows: list[Comparison], key: Callable[[Comparison], str], order: Callable[[str], Any]
) -> dict[str, Score]:
    bins: dict[str, list[Comparison]] = {}
    for row in rows:
        bins.setdefault(key(row), []).append(row)
    return {name: _score(bins[name]) for name in sorted(bins, key=order)}


def _score(rows: list[Comparison]) -> Score:
    covered = [row.covered for row in rows if row.covered is not None]
    unclamped = [
        (row.error / row.deviation) ** 2
        for row in rows
        if row.deviation is not None and row.deviation > _CERTAIN and not row.clamped
    ]
    places = [row.place_error_m**2 for row in rows if row.place_error_m is not None]
    squares = [row.place_square for row in rows if row.place_square is not None]
    count = len(rows)
    return Score(
        count,
        math.sqrt(math.fsum(row.error**2 for row in rows) / count),
        math.fsum(row.error for row in rows) / count,
        sum(covered) / len(covered) if covered else None,
        math.fsum(unclamped) / len(unclamped) if unclamped else None,
        sum(row.mode_right for row in rows) / count,
        math.sqrt(math.fsum(places) / len(places)) if places else None,
        sum(square <= _ELLIPSE_95 for square in squares) / len(squares) if squares else None,
        math.fsum(squares) / (2 * len(squares)) if squares else None,
    )
