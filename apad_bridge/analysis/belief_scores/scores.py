"""Scores beliefs: error, coverage and consistency by the age of the last packet, by mode and by aMussel."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

from apad_bridge.analysis.belief_scores.comparisons import BeliefComparison, ChargeComparison

AGES_H = ((1 / 60, "a minute"), (1.0, "1 h"), (6.0, "6 h"), (12.0, "12 h"), (24.0, "24 h"), (48.0, "48 h"))
"""The bins' upper ends, in agent time, and names; older samples have a bin of their own."""
OLDER = "older"
RELEASED = "released"
"""The row of aMussels that wait at the surface until they are clear to sink; they count as floating too."""
LOW_COVERAGE = 0.85
"""Intervals of 95 % that hold the truth more seldom than this mislead a planner."""
_ENOUGH_SAMPLES = 50
"""The least number of samples in a bin whose coverage means anything."""
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
    width: float | None
    """The mean width of that interval."""
    nees: float | None
    """The mean square of the error in deviations, without charges that rest at 0 or 1; it is 1 for consistent beliefs."""
    crps: float
    """The mean continuous ranked probability score of the charge; the mean absolute error of certain beliefs."""
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
    """By the true mode; `released` is a part of `floating`."""
    by_agent: dict[str, Score]
    secondary: Score | None
    """The charge of the secondary battery, of all aMussels; None without its deviations."""

    @property
    def overconfident(self) -> dict[str, Score]:
        """The bins of `_ENOUGH_SAMPLES` or more whose coverage is below `LOW_COVERAGE`, by a name that says which."""
        groups = {"packet up to": self.by_age, "mode": self.by_mode, "aMussel": self.by_agent}
        bins = {"all": self.overall} | (
            {} if self.secondary is None else {"secondary battery": self.secondary}
        )
        for head, group in groups.items():
            bins |= {f"{head} {name}": score for name, score in group.items()}
        return {
            name: score
            for name, score in bins.items()
            if score.samples >= _ENOUGH_SAMPLES
            and score.coverage is not None
            and score.coverage < LOW_COVERAGE
        }


def scores_of(rows: Iterable[BeliefComparison]) -> Scores | None:
    """The scores of all comparisons; None when there are none."""
    if not (comparisons := list(rows)):
        return None
    names = [name for _, name in AGES_H] + [OLDER]
    by_mode = _by(comparisons, lambda row: row.mode.name.lower().replace("_", " "), str)
    if released := [row for row in comparisons if row.is_released]:
        by_mode[RELEASED] = _score(released)
    secondary = [(row, row.secondary) for row in comparisons if row.secondary is not None]
    return Scores(
        _score(comparisons),
        _by(comparisons, lambda row: age_bin(row.age_h), names.index),
        by_mode,
        _by(comparisons, lambda row: str(row.agent_id), int),
        _score_of_charges([row for row, _ in secondary], [charge for _, charge in secondary])
        if secondary
        else None,
    )


def age_bin(age_h: float) -> str:
    return next((name for end, name in AGES_H if age_h <= end), OLDER)


def _by(
    rows: list[BeliefComparison], key: Callable[[BeliefComparison], str], order: Callable[[str], Any]
) -> dict[str, Score]:
    bins: dict[str, list[BeliefComparison]] = {}
    for row in rows:
        bins.setdefault(key(row), []).append(row)
    return {name: _score(bins[name]) for name in sorted(bins, key=order)}


def _score(rows: list[BeliefComparison]) -> Score:
    return _score_of_charges(rows, [row.primary for row in rows])


def _score_of_charges(rows: list[BeliefComparison], charges: list[ChargeComparison]) -> Score:
    covered = [charge.covered for charge in charges if charge.covered is not None]
    widths = [charge.width for charge in charges if charge.width is not None]
    unclamped = [
        (charge.error / charge.deviation) ** 2
        for charge in charges
        if charge.deviation is not None and charge.deviation > _CERTAIN and not charge.clamped
    ]
    places = [row.place_error_m**2 for row in rows if row.place_error_m is not None]
    squares = [row.place_square for row in rows if row.place_square is not None]
    count = len(rows)
    return Score(
        samples=count,
        rmse=math.sqrt(math.fsum(charge.error**2 for charge in charges) / count),
        bias=math.fsum(charge.error for charge in charges) / count,
        coverage=sum(covered) / len(covered) if covered else None,
        width=math.fsum(widths) / len(widths) if widths else None,
        nees=math.fsum(unclamped) / len(unclamped) if unclamped else None,
        crps=math.fsum(charge.crps for charge in charges) / count,
        mode_right=sum(row.mode_right for row in rows) / count,
        place_rmse_m=math.sqrt(math.fsum(places) / len(places)) if places else None,
        place_coverage=sum(square <= _ELLIPSE_95 for square in squares) / len(squares) if squares else None,
        place_nees=math.fsum(squares) / (2 * len(squares)) if squares else None,
    )
