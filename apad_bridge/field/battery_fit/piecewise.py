"""Fits a continuous piecewise-linear curve by least squares, including its breakpoints.

For given breakpoints the values at them follow from linear least squares in hat functions: a tridiagonal system whose
entries are sums over a segment's rows, computed as differences of running sums. So a trial of breakpoints costs the same
for any length of the log, and many can be tried. Breakpoints are added one at a time where they help most, each is then
moved to wherever on the whole axis it helps more, and all are refined in ever smaller steps. The sum of squares has many
local minima; this finds the deepest in all but contrived cases. Tests compare it with an exhaustive search. scipy's global
optimisers find the same curves, four to ten times slower.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]

MIN_ROWS = 3
"""The least number of rows in a segment."""
_GRID = 48
_FIRST_STEP, _LAST_STEP = 0.02, 1e-7
_GAIN = 1 - 1e-9
"""A trial is accepted only if it is better by more than rounding."""


@dataclass(frozen=True, slots=True)
class Piecewise:
    """A curve through (knot, value); the first and last knot are the first and last row's."""

    knots: tuple[float, ...]
    values: tuple[float, ...]

    @property
    def slopes(self) -> tuple[float, ...]:
        """The slope of each segment."""
        return tuple(
            (self.values[n + 1] - self.values[n]) / (self.knots[n + 1] - self.knots[n])
            for n in range(len(self.knots) - 1)
        )

    def at(self, x: Floats) -> Floats:
        return np.interp(x, self.knots, self.values)


def fit(x: Floats, y: Floats, segments: int) -> Piecewise:
    """Fits the curve with `segments` pieces to `x` (n,), never falling, and `y` (n,).

    ValueError when there are too few rows for that many pieces, or all at the same x.
    """
    if segments < 1:
        raise ValueError(f"a curve has one segment or more, not {segments}")
    if len(x) < MIN_ROWS * segments + 1 or x[0] == x[-1]:
        raise ValueError(
            f"{len(x)} rows are too few for {segments} segments: {MIN_ROWS * segments + 1} at least"
        )
    span = float(x[-1] - x[0])
    trial = _Trial((x - x[0]) / span, y)
    grown: tuple[float, ...] = ()
    for _ in range(segments - 1):
        grown = _exchange(trial, _with_one_more(trial, grown))
    if len(grown) < segments - 1:
        raise ValueError(f"the rows stand too close together in time for {segments} segments")
    starts = [grown]
    if (apart := _as_separate_lines(trial, segments)) is not None:
        starts.append(_exchange(trial, apart))
    inner = min((_refine(trial, start) for start in starts), key=trial.squares)
    _, values = trial.solve(np.array([0.0, *inner, 1.0]))
    at = [float(x[0]), *(float(x[0]) + span * knot for knot in inner), float(x[-1])]
    return Piecewise(tuple(at), tuple(float(value) for value in values))


class _Trial:
    """The sum of squares for given breakpoints, x on [0, 1]."""

    def __init__(self, x: Floats, y: Floats) -> None:
        self.x = x
        self._mean = float(y.mean())
        y = y - self._mean
        self._total = float(y @ y)
        zero = np.zeros(1)
        self._sums = tuple(np.concatenate((zero, np.cumsum(it))) for it in (x, x * x, y, x * y, y * y))

    def solve(self, knots: Floats) -> tuple[float, Floats]:
        """Returns (sum of squares, values at the knots); the sum is infinite if a segment has too few rows."""
        cut = np.searchsorted(self.x, knots)
        cut[-1] = len(self.x)
        count = np.diff(cut).astype(float)
        if count.min() < MIN_ROWS:
            return np.inf, np.zeros(len(knots))
        sx, sxx, sy, sxy, _ = (np.diff(sums[cut]) for sums in self._sums)
        left, width = knots[:-1], np.diff(knots)
        w = (sx - left * count) / width
        ww = (sxx - 2 * left * sx + left * left * count) / width**2
        wy = (sxy - left * sy) / width
        size = len(knots)
        gram = np.zeros((size, size))
        right = np.zeros(size)
        at = np.arange(size - 1)
        gram[at, at] += count - 2 * w + ww
        gram[at + 1, at + 1] += ww
        gram[at, at + 1] += w - ww
        gram[at + 1, at] += w - ww
        right[:-1] += sy - wy
        right[1:] += wy
        try:
            values = np.linalg.solve(gram, right).astype(np.float64)
        except np.linalg.LinAlgError:
            return np.inf, right
        return max(0.0, self._total - float(values @ right)), values + self._mean

    def line_squares(self, begin: float, end: float) -> float:
        """The sum of squares of one line's fit to the rows from `begin` to `end`; infinite for too few rows."""
        first, last = np.searchsorted(self.x, (begin, end))
        if end >= 1:
            last = len(self.x)
        count = float(last - first)
        if count < MIN_ROWS:
            return np.inf
        sx, sxx, sy, sxy, syy = (float(sums[last] - sums[first]) for sums in self._sums)
        spread = sxx - sx * sx / count
        slope = (sxy - sx * sy / count) / spread if spread > 0 else 0.0
        return max(0.0, syy - sy * sy / count - slope * (sxy - sx * sy / count))

    def squares(self, inner: tuple[float, ...]) -> float:
        return self.solve(np.array([0.0, *inner, 1.0]))[0]


def _with_one_more(trial: _Trial, inner: tuple[float, ...]) -> tuple[float, ...]:
    """Adds one breakpoint where it helps most on a grid; returns the same breakpoints when no place is left for it."""
    trials = [tuple(sorted((*inner, float(at)))) for at in _grid(trial)]
    best = min(trials, key=trial.squares, default=inner)
    return best if trial.squares(best) < np.inf else inner


def _as_separate_lines(trial: _Trial, segments: int) -> tuple[float, ...] | None:
    """The breakpoints on the grid of the best `segments` lines that need not meet; None where no grid place allows them.

    Dynamic programming finds them exactly (R. Bellman and R. Roth, "Curve fitting by segmented straight lines", 1969). They
    lie near the breakpoints of the continuous curve, wherever the search from few to many breakpoints ends in a hollow.
    """
    places = np.array([0.0, *(at for at in _grid(trial) if 0 < at < 1), 1.0])
    squares = np.array([[trial.line_squares(a, b) if a < b else np.inf for b in places] for a in places])
    best, came_from = squares[0], []
    for _ in range(segments - 1):
        total = best[:, None] + squares
        came_from.append(total.argmin(axis=0))
        best = total.min(axis=0)
    if not np.isfinite(best[-1]):
        return None
    inner, at = [], len(places) - 1
    for before in reversed(came_from):
        at = int(before[at])
        inner.append(float(places[at]))
    found = tuple(reversed(inner))
    return found if trial.squares(found) < np.inf else None


def _exchange(trial: _Trial, inner: tuple[float, ...]) -> tuple[float, ...]:
    """Removes each breakpoint and adds it again where it helps most, until none moves."""
    best = trial.squares(inner)
    moved = True
    while moved:
        moved = False
        for n in range(len(inner)):
            other = _with_one_more(trial, inner[:n] + inner[n + 1 :])
            squares = trial.squares(other)
            if len(other) == len(inner) and squares < best * _GAIN:
                inner, best, moved = other, squares, True
    return inner


def _refine(trial: _Trial, inner: tuple[float, ...]) -> tuple[float, ...]:
    """Moves single breakpoints and pairs of neighbours, by ever smaller steps until no step helps."""
    best = trial.squares(inner)
    step = _FIRST_STEP
    groups = [(n,) for n in range(len(inner))] + [(n, n + 1) for n in range(len(inner) - 1)]
    while step > _LAST_STEP:
        moved = False
        for group in groups:
            for by in (step, -step):
                other = tuple(at + by if n in group else at for n, at in enumerate(inner))
                if not all(a < b for a, b in zip((0.0, *other), (*other, 1.0), strict=True)):
                    continue
                if (squares := trial.squares(other)) < best * _GAIN:
                    inner, best, moved = other, squares, True
        if not moved:
            step /= 2
    return inner


def _grid(trial: _Trial) -> Floats:
    """The grid of trial places: half evenly in x, half evenly in rows, because the density of a log may vary."""
    even = np.linspace(0, 1, _GRID // 2 + 2)[1:-1]
    by_row = trial.x[np.linspace(0, len(trial.x) - 1, _GRID // 2 + 2).astype(int)[1:-1]]
    places: Floats = np.unique(np.concatenate((even, by_row)))
    return places
