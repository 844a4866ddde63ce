"""Fits a battery's log to the numbers of a scenario's board block, as section IV-A of the paper did with its recordings."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from enum import StrEnum
from math import fsum
from typing import Any

import numpy as np

from apad_bridge.field.battery_fit.battery_log import BatteryLog, Floats, LogError
from apad_bridge.field.battery_fit.piecewise import Piecewise, fit

DEFAULT_SEGMENTS = {"charging": 3, "discharging": 1}
"""The segments of equations (2) and (1)."""
_RATE_DECIMALS = 10
"""The decimals that the board's arithmetic accepts."""
_END_DECIMALS = 5
_LEAST_RISE = 0.02
"""The least change on [0, 1] of a straight line over a whole charge or discharge; less is neither."""
_GAP = 10
"""Rows this many times farther apart than usual have a gap between them."""


class Direction(StrEnum):
    CHARGING = "charging"
    DISCHARGING = "discharging"


@dataclass(frozen=True, slots=True)
class Segment:
    """A straight piece: minutes and scaled voltage at its ends, its rate a minute, and the rows' residuals."""

    from_min: float
    to_min: float
    from_scaled: float
    to_scaled: float
    per_min: float
    rows: int
    rmse: float
    max_abs: float


@dataclass(frozen=True, slots=True)
class BatteryFit:
    """A fitted log. `minutes` and `scaled` are the used rows; `curve` is a function of minutes."""

    log: str
    direction: Direction
    minutes: Floats
    scaled: Floats
    curve: Piecewise
    segments: tuple[Segment, ...]
    rmse: float
    max_abs: float
    outside: int
    """The number of rows before and after the part of the log that lies on the scale."""
    left_out: int
    gaps: tuple[tuple[float, float], ...]
    """(from, to) in minutes where rows are missing."""

    @property
    def discharge_per_min(self) -> float:
        """The one rate of equation (1): that of a straight line through all rows."""
        return round(-fit(self.minutes, self.scaled, 1).slopes[0], _RATE_DECIMALS)

    @property
    def charge_segments(self) -> tuple[tuple[float, float], ...]:
        """(upper end, rate a minute) of each segment, the first from 0 and the last to 1, however far the log reaches."""
        ends: list[tuple[float, float]] = []
        for segment in self.segments:
            end = round(segment.to_scaled, _END_DECIMALS)
            if end > 0:
                ends.append((min(end, 1.0), round(segment.per_min, _RATE_DECIMALS)))
            if end >= 1:
                break
        return (*ends[:-1], (1.0, ends[-1][1]))

    @property
    def discharge_curve(self) -> tuple[tuple[float, float], ...]:
        """(charge, scaled voltage), rising: a constant load takes the charge evenly from full to empty."""
        full_min, empty_min = self.segments[0].from_min, self.segments[-1].to_min
        ends = [
            (full_min, self.segments[0].from_scaled),
            *((it.to_min, it.to_scaled) for it in self.segments),
        ]
        return tuple(
            (
                round((empty_min - at_min) / (empty_min - full_min), _END_DECIMALS),
                round(min(1.0, max(0.0, scaled)), _END_DECIMALS),
            )
            for at_min, scaled in reversed(ends)
        )

    def to_json(self) -> dict[str, Any]:
        return {
            "log": self.log,
            "direction": self.direction.value,
            "rows": len(self.minutes),
            "rows_outside_the_scale": self.outside,
            "rows_without_a_value": self.left_out,
            "gaps_min": [list(gap) for gap in self.gaps],
            "rmse": self.rmse,
            "max_abs": self.max_abs,
            "segments": [asdict(segment) for segment in self.segments],
        }


def fit_log(log: BatteryLog, segments: int | None = None, direction: Direction | None = None) -> BatteryFit:
    """Fits the part of a log that lies on [0, 1]. LogError has the fault of the log and its remedy."""
    found = direction_of(log, direction)
    used = _span_on_scale(log, found)
    minutes, scaled = log.minutes[used], log.scaled[used]
    wanted = segments or DEFAULT_SEGMENTS[found]
    try:
        curve = fit(minutes, scaled, wanted)
    except ValueError as error:
        raise LogError(
            f"{log.name}: of {len(log.minutes)} rows {len(minutes)} lie on the scale; {error}"
        ) from None
    pieces = _segments(minutes, scaled, curve)
    _refuse_wrong_way(log.name, pieces, found)
    residuals = scaled - curve.at(minutes)
    return BatteryFit(
        log=log.name,
        direction=found,
        minutes=minutes,
        scaled=scaled,
        curve=curve,
        segments=pieces,
        rmse=_rms(residuals),
        max_abs=float(np.abs(residuals).max()),
        outside=len(log.minutes) - len(minutes),
        left_out=log.left_out,
        gaps=_gaps(minutes),
    )


def along(log: BatteryLog, discharge: BatteryFit, lift: float) -> BatteryLog:
    """A charge's log with its charge in place of its voltage, which a charger lifts by `lift` on [0, 1].

    It ends where the voltage is full: a charger holds it there, and it shows the charge no longer.
    """
    charges, voltages = zip(*discharge.discharge_curve, strict=True)
    full = np.flatnonzero(log.scaled >= 1)
    end = int(full[0]) + 1 if len(full) else len(log.scaled)
    return replace(
        log, minutes=log.minutes[:end], scaled=np.interp(log.scaled[:end] - lift, voltages, charges)
    )


def minutes_to_full(segments: tuple[tuple[float, float], ...]) -> float:
    """The minutes from 0 to 1 along a scenario's `charge_segments`."""
    starts = (0.0, *(end for end, _ in segments[:-1]))
    return fsum((end - start) / rate for start, (end, rate) in zip(starts, segments, strict=True))


def direction_of(log: BatteryLog, given: Direction | None) -> Direction:
    """The direction of a log as a whole; LogError where it has none, or another than the one that is given."""
    if len(log.minutes) < 4:
        raise LogError(f"{log.name}: {len(log.minutes)} rows are too few: 4 at least")
    slope = np.polynomial.Polynomial.fit(log.minutes - log.minutes[0], log.scaled, 1).convert().coef
    rise = float(slope[1]) * float(log.minutes[-1] - log.minutes[0]) if len(slope) > 1 else 0.0
    if abs(rise) < _LEAST_RISE:
        if given is None:
            raise LogError(
                f"{log.name}: neither rises nor falls as a whole: cut it to one charge or one discharge, or give "
                "--direction"
            )
        return given
    found = Direction.CHARGING if rise > 0 else Direction.DISCHARGING
    if given is not None and given is not found:
        raise LogError(
            f"{log.name}: goes the wrong way for {given}: as a whole it {'rises' if rise > 0 else 'falls'}"
        )
    return found


def _span_on_scale(log: BatteryLog, direction: Direction) -> slice:
    """The rows from the last one at the scale's starting end to the first one at its other end, without rests there."""
    up = log.scaled if direction is Direction.CHARGING else 1 - log.scaled
    at_end = np.flatnonzero(up >= 1)
    stop = int(at_end[0]) + 1 if len(at_end) else len(up)
    at_start = np.flatnonzero(up[:stop] <= 0)
    start = int(at_start[-1]) if len(at_start) else 0
    return slice(start, stop)


def _segments(minutes: Floats, scaled: Floats, curve: Piecewise) -> tuple[Segment, ...]:
    residuals = scaled - curve.at(minutes)
    cut = np.searchsorted(minutes, curve.knots)
    cut[-1] = len(minutes)
    return tuple(
        Segment(
            from_min=curve.knots[n],
            to_min=curve.knots[n + 1],
            from_scaled=curve.values[n],
            to_scaled=curve.values[n + 1],
            per_min=slope,
            rows=int(cut[n + 1] - cut[n]),
            rmse=_rms(residuals[cut[n] : cut[n + 1]]),
            max_abs=float(np.abs(residuals[cut[n] : cut[n + 1]]).max()),
        )
        for n, slope in enumerate(curve.slopes)
    )


def _refuse_wrong_way(name: str, pieces: tuple[Segment, ...], direction: Direction) -> None:
    sign = 1 if direction is Direction.CHARGING else -1
    for n, piece in enumerate(pieces, 1):
        if round(sign * piece.per_min, _RATE_DECIMALS) <= 0:
            raise LogError(
                f"{name}: segment {n} of {len(pieces)}, from {piece.from_min:.1f} to {piece.to_min:.1f} min, goes the "
                f"wrong way for {direction} ({piece.per_min:+.6f} a minute): ask for fewer segments, cut the log to one "
                "charge or discharge, or give the other --direction"
            )


def _gaps(minutes: Floats) -> tuple[tuple[float, float], ...]:
    steps = np.diff(minutes)
    usual = float(np.median(steps))
    wide = np.flatnonzero((steps > _GAP * usual) & (usual > 0))
    return tuple((float(minutes[n]), float(minutes[n + 1])) for n in wide)


def _rms(residuals: Floats) -> float:
    return float(np.sqrt(np.mean(residuals**2)))
