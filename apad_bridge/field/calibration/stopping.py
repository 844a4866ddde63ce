"""The stopping distance, from the ends of many legs at once.

One leg tells little of its stop where positions scatter, and a fit of each leg by itself is biased: it takes the noise's
farthest place for the vehicle's. So all legs share one stopping distance here, and each has its own time of braking, place
and speed. The interval comes from the legs' scores, the slopes of their squared errors over the shared distance. It holds
the distances at which the mean score does not differ from 0 by Student's t (Godambe 1960, "An optimum property of regular
maximum likelihood estimation"). It asks of the noise only that it is independent from leg to leg.

A stop has one of two shapes: thrusters brake with a constant deceleration, and the water slows a hull without thrust by a
share of its speed. The shape that fits counts. Where the noise hides which one that is, the interval reaches from the
shorter distance to the longer one, and so far beyond both that either shape's truth lies in it with 95 % (Imbens and Manski
2004, "Confidence intervals for partially identified parameters"). The figure is then the longer distance, the safer one.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import stats
from scipy.optimize import brentq

from apad_bridge.field.calibration.intervals import CONFIDENCE, Figure, Floats

LEAST_STOPS = 3
LOOKED_S = 6.0
"""Seconds after the time at which it would have come to its place of rest at the speed of its cruise."""
_RETURN_S = 1.5
"""So much of a motion after the rest is looked at: later it has another shape."""
_LEAST_SHARE = 0.1
"""A shared distance below this share of the stops' own first guesses is not believed."""
_WIDE: Floats = np.asarray(np.geomspace(0.05, 4.0, 25), np.float64)
"""First pass, in parts of the first guess."""
_NARROW = 17
_COARSE: Floats = np.asarray(np.linspace(-1.5, 1.5, 13), np.float64)
_FINE: Floats = np.asarray(np.linspace(-0.27, 0.27, 13), np.float64)
"""Seconds about the guessed begin of a braking, and about the best of those."""
_NOISY_M = 0.1
"""Positions that scatter by more do not tell a stop from the begin of a motion back: there any sign of one is enough."""
_REST_S, _LATER_S, _BACK_M = 1.0, 2.5, 0.02
_SMALL: Floats = np.asarray(1e-9 * np.eye(4), np.float64)
_SHAPE_LEVEL = 0.01
"""Level of the test by which one shape is told from the other."""
_SURE, _DOUBTED = 0.001, 0.05
"""Levels of the test by which a motion after the rest is told from noise."""


Interval = tuple[float, float, float]
"""(low, middle, high) of a stopping distance: m."""


@dataclass(frozen=True, slots=True)
class StopTrack:
    """The end of a leg, from its cruise to some seconds after its rest: metres along the way."""

    times_s: Floats
    along_m: Floats
    speed_m_s: float
    """The speed of its cruise."""
    guess_m: float
    """A first guess of its stopping distance ..."""
    corner_s: float
    """... and of the time at which it would have come to its place of rest at the speed of its cruise."""

    @property
    def noise_m(self) -> float:
        """The deviation of one position, by the second differences of the way."""
        return float(np.std(np.diff(self.along_m, 2)) / np.sqrt(6))

    def until(self, time_s: float) -> StopTrack:
        used = self.times_s < time_s
        return replace(self, times_s=self.times_s[used], along_m=self.along_m[used])


def stopping_distance(tracks: Sequence[StopTrack]) -> Figure | None:
    """The stopping distance at the tracks' mean speed with its interval: m.

    None below three stops, and where the noise hides how long it is: at most, or before a motion back.
    """
    if len(tracks) < LEAST_STOPS:
        return None
    speed_m_s = float(np.mean([it.speed_m_s for it in tracks]))
    rest_m = float(np.median([it.guess_m for it in tracks]))
    is_noisy = float(np.median([it.noise_m for it in tracks])) > _NOISY_M
    if returns := _returns(tracks, rest_m, _DOUBTED if is_noisy else _SURE):
        if is_noisy:
            return None
        tracks = [it.until(it.corner_s + rest_m / it.speed_m_s + _RETURN_S) for it in tracks]
    wide_m = _WIDE * rest_m
    shapes: tuple[Shape, ...] = (_constant, _exponential)
    wide = {it: _errors(tracks, wide_m, speed_m_s, it, returns=returns) for it in shapes}
    found = [_found(tracks, wide_m, wide[it], speed_m_s, it, returns=returns) for it in _shapes_of(wide)]
    intervals = [it for it in found if it is not None]
    if len(intervals) < len(found):
        return None
    low_m, middle_m, high_m = intervals[0]
    if len(intervals) > 1 and is_noisy:
        low_m, middle_m, high_m = of_both(intervals[0], intervals[1], len(tracks))
    elif len(intervals) > 1:
        # With good positions few days hide their shape. Their intervals count whole: no other rule was better on made days.
        low_m, high_m = min(it[0] for it in intervals), max(it[2] for it in intervals)
        middle_m = max(it[1] for it in intervals)
    if middle_m <= _LEAST_SHARE * rest_m:
        return None
    # A braking that begins between two positions is not known better than this.
    period_s = float(np.median([np.median(np.diff(it.times_s)) for it in tracks]))
    half_m = speed_m_s * period_s / 4
    low_m, high_m = min(low_m, middle_m - half_m), max(high_m, middle_m + half_m)
    return Figure(middle_m, max(0.0, low_m), high_m, len(tracks), "m", "shared fit, scores")


def _shapes_of(wide: Mapping[Shape, Floats]) -> list[Shape]:
    """The shape that fits, by a paired t test of the legs' least errors; both where none is sure."""
    least = {it: errors[:, int(np.argmin(errors.sum(axis=0)))] for it, errors in wide.items()}
    if stats.ttest_rel(least[_constant], least[_exponential]).pvalue >= _SHAPE_LEVEL:
        return [_constant, _exponential]
    return [min(least, key=lambda it: float(least[it].sum()))]


def of_both(one: Interval, other: Interval, stops: int) -> Interval:
    """The interval that holds the distance of either shape with the same confidence; its middle is the longer one's.

    Each truth can fall out at one side only where the two are far apart, and at both where they are alike.
    """
    shorter, longer = sorted((one, other), key=lambda it: it[1])
    two_sided = float(stats.t.ppf(0.5 + CONFIDENCE / 2, stops - 1))
    errors_m = (shorter[1] - shorter[0]) / two_sided, (longer[2] - longer[1]) / two_sided
    apart = (longer[1] - shorter[1]) / max(*errors_m, 1e-9)
    factor = brentq(
        lambda it: stats.t.cdf(it + apart, stops - 1) - stats.t.cdf(-it, stops - 1) - CONFIDENCE,
        0.0,
        two_sided,
    )
    return shorter[1] - factor * errors_m[0], longer[1], longer[1] + factor * errors_m[1]


def _found(
    tracks: Sequence[StopTrack],
    wide_m: Floats,
    errors: Floats,
    speed_m_s: float,
    shape: Shape,
    *,
    returns: bool,
) -> Interval | None:
    """The interval of one shape. None where the noise hides how long the stop is at most."""
    low_m, middle_m, high_m = _interval(wide_m, errors)
    if high_m >= wide_m[-1] or middle_m <= wide_m[0]:
        return None
    narrow_m = np.asarray(np.geomspace(low_m / 1.1, 1.1 * high_m, _NARROW), np.float64)
    return _interval(narrow_m, _errors(tracks, narrow_m, speed_m_s, shape, returns=returns))


def _interval(distances_m: Floats, errors: Floats) -> Interval:
    """The interval by the squared errors (stops x distances)."""
    scores = np.gradient(errors, np.log(distances_m), axis=1)
    means = scores.mean(axis=0)
    spreads = scores.std(axis=0, ddof=1) / np.sqrt(len(errors))
    bounds = stats.t.ppf(0.5 + CONFIDENCE / 2, len(errors) - 1) * spreads
    best = int(np.argmin(errors.sum(axis=0)))
    low, middle, high = (_root(distances_m, it, best) for it in (means + bounds, means, means - bounds))
    return low, middle, high


def _root(distances_m: Floats, values: Floats, best: int) -> float:
    """The distance nearest to the best one at which the values come from below 0 to above; else an end of the grid."""
    crossings = np.flatnonzero((values[:-1] < 0) & (values[1:] >= 0))
    if not len(crossings):
        return float(distances_m[0] if values[0] >= 0 else distances_m[-1])
    n = int(crossings[np.argmin(np.abs(crossings - best))])
    share = -values[n] / (values[n + 1] - values[n])
    return float(distances_m[n] * (distances_m[n + 1] / distances_m[n]) ** share)


def _returns(tracks: Sequence[StopTrack], rest_m: float, level: float) -> bool:
    """A hold takes the vehicle back, by a paired t test of this level: its place at rest against one some seconds later.

    Tracks that end too soon to tell count as such.
    """
    backs_m = []
    for it in tracks:
        since_s = it.times_s - it.corner_s - rest_m / it.speed_m_s
        at_rest, later = (since_s > -_REST_S / 2) & (since_s < _REST_S / 2), since_s > _LATER_S
        if at_rest.any() and later.any():
            backs_m.append(float(it.along_m[at_rest].mean() - it.along_m[later].mean()))
    if len(backs_m) < LEAST_STOPS:
        return True
    back_m = float(np.mean(backs_m))
    return back_m > _BACK_M and bool(stats.ttest_1samp(backs_m, 0.0, alternative="greater").pvalue < level)


Shape = Callable[[Floats, float], Floats]
"""The way (in seconds of the cruise) at times since a braking began, by the stopping distance in seconds of the cruise."""


def _constant(since_s: Floats, stopping_s: float) -> Floats:
    """A constant deceleration, for twice as long as the cruise takes for the distance."""
    braked_s = np.clip(since_s, 0, 2 * stopping_s)
    return np.asarray(np.minimum(since_s, 0) + braked_s - braked_s**2 / (4 * stopping_s))


def _exponential(since_s: Floats, stopping_s: float) -> Floats:
    """A deceleration in proportion to the speed, which falls to 1/e while the cruise would take the distance."""
    braked_s = np.clip(since_s, 0, None)
    return np.asarray(np.minimum(since_s, 0) - stopping_s * np.expm1(-braked_s / stopping_s))


def _errors(
    tracks: Sequence[StopTrack], distances_m: Floats, speed_m_s: float, shape: Shape, *, returns: bool
) -> Floats:
    """Squared errors (stops x distances), each by the best time of braking, place and speed of its stop.

    The distance grows with the square of the speed under a constant deceleration, and with the speed under the other.
    """
    rows = []
    for it in tracks:
        along_m = it.along_m - it.along_m.mean()
        stopping_s = distances_m / speed_m_s
        if shape is _constant:
            stopping_s = stopping_s * it.speed_m_s / speed_m_s
        rows.append([_least_error(it, along_m, shape, float(each_s), returns) for each_s in stopping_s])
    return np.array(rows)


def _least_error(track: StopTrack, along_m: Floats, shape: Shape, stopping_s: float, returns: bool) -> float:
    """The least squared error of a stop of this distance, over the time at which it begins."""
    begins_s = track.corner_s - stopping_s + _COARSE
    coarse = _errors_at(track.times_s, along_m, begins_s, shape, stopping_s, returns)
    begins_s = begins_s[int(np.argmin(coarse))] + _FINE
    fine = _errors_at(track.times_s, along_m, begins_s, shape, stopping_s, returns)
    best = int(np.argmin(fine))
    if best in (0, len(fine) - 1):
        return float(fine[best])
    before, at, after = fine[best - 1 : best + 2]
    curvature = before - 2 * at + after
    return float(at - (before - after) ** 2 / (8 * curvature) if curvature > 0 else at)


def _errors_at(
    times_s: Floats, along_m: Floats, begins_s: Floats, shape: Shape, stopping_s: float, returns: bool
) -> Floats:
    """The squared error for each time at which the braking may begin; place, speed and return are fitted linearly."""
    since_s = times_s[None, :] - begins_s[:, None]
    way_s = shape(since_s, stopping_s)
    columns = [np.ones_like(way_s), way_s]
    if returns:
        after_s = np.clip(since_s - 2 * stopping_s, 0, None)
        columns += [after_s**2, after_s**3]
    rows = np.stack(columns, axis=-1)
    # Of a return that no position shows nothing is known: the small term keeps its part at 0.
    products = np.swapaxes(rows, 1, 2) @ rows + _SMALL[: len(columns), : len(columns)]
    targets = np.swapaxes(rows, 1, 2) @ along_m
    slopes = np.linalg.solve(products, targets[..., None])[..., 0]
    residuals = along_m[None, :] - (rows @ slopes[..., None])[..., 0]
    return np.asarray((residuals**2).sum(axis=1))
