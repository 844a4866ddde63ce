"""Error, coverage and consistency of beliefs, by the age of the last packet, by mode and by aMussel."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import asdict, dataclass
from typing import Any

from apad_bridge.analysis.belief_scores.compared import Compared

AGES_H = ((1 / 60, "a minute"), (1.0, "1 h"), (6.0, "6 h"), (12.0, "12 h"), (24.0, "24 h"), (48.0, "48 h"))
"""Upper ends of the bins, of agent time, and their names; what is older is in one of its own."""
OLDER = "older"
_CERTAIN = 1e-9
_ELLIPSE_95 = -2 * math.log(0.05)
"""Of the squared deviation in two dimensions, what 95 % lie below."""


@dataclass(frozen=True, slots=True)
class Score:
    """Of one bin. None where nobody claims an interval, or nothing is free of the ends."""

    samples: int
    rmse: float
    bias: float
    coverage: float | None
    """Share of samples in the interval of 95 %."""
    nees: float | None
    """Mean square of the error in deviations, 1 for one that knows itself; charges that rest at 0 or 1 apart."""
    mode_right: float
    place_rmse_m: float | None
    place_coverage: float | None
    """Share of places in the believed ellipse of 95 %; None, as below, where no deviation of a place is recorded."""
    place_nees: float | None
    """Of both axes, divided by two."""


@dataclass(frozen=True, slots=True)
class Scores:
    overall: Score
    by_age: dict[str, Score]
    by_mode: dict[str, Score]
    by_agent: dict[str, Score]

    def to_json(self) -> dict[str, Any]:
        return asdict(self)


def scores_of(rows: Iterable[Compared]) -> Scores | None:
    """None when there is nothing to compare."""
    found = list(rows)
    if not found:
        return None
    names = [name for _, name in AGES_H] + [OLDER]
    return Scores(
        _score(found),
        _by(found, lambda row: age_bin(row.age_h), names.index),
        _by(found, lambda row: row.mode.name.lower().replace("_", " "), str),
        _by(found, lambda row: str(row.agent_id), int),
    )


def age_bin(age_h: float) -> str:
    return next((name for end, name in AGES_H if age_h <= end), OLDER)


def _by(
    rows: list[Compared], key: Callable[[Compared], str], order: Callable[[str], Any]
) -> dict[str, Score]:
    bins: dict[str, list[Compared]] = {}
    for row in rows:
        bins.setdefault(key(row), []).append(row)
    return {name: _score(bins[name]) for name in sorted(bins, key=order)}


def _score(rows: list[Compared]) -> Score:
    covered = [row.covered for row in rows if row.covered is not None]
    free = [
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
        math.fsum(free) / len(free) if free else None,
        sum(row.mode_right for row in rows) / count,
        math.sqrt(math.fsum(places) / len(places)) if places else None,
        sum(square <= _ELLIPSE_95 for square in squares) / len(squares) if squares else None,
        math.fsum(squares) / (2 * len(squares)) if squares else None,
    )
