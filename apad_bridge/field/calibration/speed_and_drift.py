"""Speed, stopping distance and drift, from the track of a vehicle.

A go-to is fitted as the trapezoid of a vehicle that accelerates evenly, cruises and brakes evenly. That is the profile of
the simulated aPad, so the fitted numbers are those that make it move like the real one.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from apad_bridge.assembly.stacks import adrift_ms
from apad_bridge.field.calibration.intervals import Floats
from apad_bridge.field.calibration.stopping import LOOKED_S, StopTrack
from apad_bridge.field.field_log.log_facts import Work
from apad_bridge.field.field_log.vehicle_log import Done, Track, VehicleLog

LEAST_LEG_M = 3.0
"""A shorter go-to has no cruise to speak of."""
LEAST_CRUISE_S = 2.0
_AFTERWARDS_S = 8.0
"""Its end is reported before the vehicle is at rest: within the victory radius."""
_RATE_HZ = 5.0
_SLOWEST_S = 0.25
"""Places farther apart do not show the course of a braking. The choice rests on the log, not on what was fitted: to keep
the long brakings alone would measure them too long."""
_SMOOTHED_S = 1.0
_SETTLED_S = 0.3
_CORNERS_S = 2.0
"""A hold takes a vehicle back by less than this at the speed of its cruise."""
_CRUISE_S = 10.0
"""So much of a cruise is enough to know its line."""
_SETTLING_S = 5.0
"""A vehicle whose controllers go off takes so long to come to the water's speed."""
_BLOCK_S = 30.0
"""A long drift counts as several samples of this length."""


@dataclass(frozen=True, slots=True)
class FlownLeg:
    """A go-to as it was flown: its trapezoid. `stop` is None where places come too seldom to show the braking."""

    done: Done
    speed_m_s: float
    length_m: float
    misfit_m: float
    """Root mean square of the distance between the trapezoid and the way, the positions' noise taken off."""
    stop: StopTrack | None


def trapezoid(
    times_s: Floats, begin_s: float, speed: float, starting_m: float, brakes_s: float, stopping_m: float
) -> Floats:
    """Metres along the way at each time: from rest at `begin_s` to `speed` (m/s) within `starting_m`, and from
    `brakes_s` to rest within `stopping_m`."""
    up_s, down_s = 2 * starting_m / speed, 2 * stopping_m / speed
    since_s = np.clip(times_s - begin_s, 0, None)
    up = np.minimum(since_s, up_s)
    metres = speed * up**2 / (2 * up_s) + speed * np.clip(
        np.minimum(times_s, brakes_s) - begin_s - up_s, 0, None
    )
    down = np.clip(times_s - brakes_s, 0, down_s)
    return np.asarray(metres + speed * down - speed * down**2 / (2 * down_s))


def legs_of(log: VehicleLog) -> Iterator[FlownLeg]:
    """The go-tos that are long enough to cruise; others, and those that a pilot or another order ended, are left out."""
    go_tos = log.of(Work.GO_TO)
    for n, done in enumerate(go_tos):
        if not done.is_done:
            continue
        later = (
            it.began_s for it in go_tos[n + 1 :] if _way_m(log.track.between(it.began_s, it.ended_s)) > 1.0
        )
        until_s = min(done.ended_s + _AFTERWARDS_S, next(later, np.inf))
        if (leg := _fitted(log.track.between(done.began_s, until_s), done)) is not None:
            yield leg


def _way_m(track: Track) -> float:
    if len(track) < 2:
        return 0.0
    return float(np.hypot(track.north_m[-1] - track.north_m[0], track.east_m[-1] - track.east_m[0]))


def _fitted(track: Track, done: Done) -> FlownLeg | None:
    under_way = track.times_s <= done.ended_s
    count = int(under_way.sum())
    if count < 10:
        return None
    length_m = float(
        np.hypot(track.north_m[count - 1] - track.north_m[0], track.east_m[count - 1] - track.east_m[0])
    )
    if length_m < LEAST_LEG_M:
        return None
    bow_n = (track.north_m[count - 1] - track.north_m[0]) / length_m
    bow_e = (track.east_m[count - 1] - track.east_m[0]) / length_m
    along_m = (track.north_m - track.north_m[0]) * bow_n + (track.east_m - track.east_m[0]) * bow_e
    whole_m = along_m
    period_s = float(np.median(np.diff(track.times_s)))
    # What it does after it has come farthest is another motion: a hold takes it back. Noise has a farthest place, too.
    box = max(1, round(_SMOOTHED_S / period_s))
    smooth_m = np.convolve(along_m, np.ones(box) / box, mode="valid")
    last = min(len(along_m), int(np.argmax(smooth_m)) + box)
    step = max(1, round(1 / (_RATE_HZ * period_s)))
    times_s, along_m = track.times_s[:last:step] - track.times_s[0], along_m[:last:step]
    if len(times_s) < 10:
        return None
    end_s = times_s[-1]
    middle = slice(len(times_s) // 3, 2 * len(times_s) // 3)
    rough = float(np.polyfit(times_s[middle], along_m[middle], 1)[0])
    if rough <= 0.01:
        return None
    guess = np.array(
        [0.0, rough, min(1.0, length_m / 4), max(0.6 * end_s, end_s - 2.0), min(1.0, length_m / 4), 0.0]
    )
    low = [-2.0, rough / 3, 1e-3, 0.2 * end_s, 1e-3, -2.0]
    high = [max(2.0, 0.3 * end_s), 3 * rough, length_m, end_s, length_m, 2.0]
    fit = least_squares(
        lambda it: trapezoid(times_s, *it[:5]) + it[5] - along_m,
        np.clip(guess, np.add(low, 1e-6), np.subtract(high, 1e-6)),
        bounds=(low, high),
        x_scale=[1.0, rough, 1.0, 1.0, 1.0, 1.0],
        max_nfev=200,
    )
    begin_s, speed, starting_m, brakes_s, stopping_m, _ = map(float, fit.x)
    cruises_s = begin_s + 2 * starting_m / speed
    if not fit.success or brakes_s - cruises_s < LEAST_CRUISE_S:
        return None
    noise_m2 = float(np.mean(np.diff(fit.fun) ** 2)) / 2
    misfit_m = float(np.sqrt(max(0.0, np.mean(fit.fun**2) - noise_m2)))
    stop = None
    if period_s <= _SLOWEST_S:
        whole_s = track.times_s - track.times_s[0]
        # The trapezoid's corner, unless noise led it away: then the one of where the vehicle came to lie.
        lies_m = np.median(whole_m[whole_s >= min(done.ended_s - track.times_s[0] + 2, whole_s[-1] - 1)])
        corner_s = float(times_s[middle].mean() + (lies_m - along_m[middle].mean()) / rough)
        if abs(brakes_s + stopping_m / speed - corner_s) < _CORNERS_S:
            corner_s = brakes_s + stopping_m / speed
        from_s = max(cruises_s + _SETTLED_S, corner_s - _CRUISE_S)
        used = (whole_s > from_s) & (whole_s < corner_s + LOOKED_S)
        stop = StopTrack(whole_s[used], whole_m[used], speed, stopping_m, corner_s)
    return FlownLeg(done, speed, length_m, misfit_m, stop)


def drifts_m_s(log: VehicleLog, adrift_s: tuple[tuple[float, float], ...]) -> list[tuple[float, float]]:
    """Velocities (north, east) with the controllers off: one for each block of up to 30 s.

    `adrift_s` are spans that a person names. Generation B also drifts for 27 s before its own dockings and undockings.
    """
    servo_s = adrift_ms() / 1000
    spans = [
        *adrift_s,
        *((it.began_s, it.began_s + servo_s) for it in log.servos if it.ended_s - it.began_s >= servo_s),
    ]
    found = []
    for from_s, to_s in spans:
        free_s = to_s - from_s - _SETTLING_S
        blocks = max(1, int(free_s // _BLOCK_S))
        for n in range(blocks):
            begin_s = from_s + _SETTLING_S + n * free_s / blocks
            track = log.track.between(begin_s, begin_s + free_s / blocks)
            if len(track) >= 10:
                since_s = track.times_s - track.times_s[0]
                found.append(
                    tuple(float(np.polyfit(since_s, it, 1)[0]) for it in (track.north_m, track.east_m))
                )
    return [(north, east) for north, east in found]
