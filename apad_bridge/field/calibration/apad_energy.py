"""Energy: what the vehicle draws at rest, for each metre, and for each aMussel in a dock; from its battery's readings."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from apad_bridge.field.calibration.intervals import Figure, Floats, regression
from apad_bridge.field.calibration.reflight import Reflown, impulse_at, way_at
from apad_bridge.field.field_log.vehicle_log import VehicleLog

PERIOD_S = 60.0
"""Readings closer than this, or than two of their own steps, repeat each other's rounding."""
_S_PER_H = 3600


@dataclass(frozen=True, slots=True)
class EnergyFigures:
    rest_w: Figure | None
    per_metre_wh: Figure | None
    per_newton_w: Figure | None
    """Watts of the simulated thrusters for each newton, so that they draw what the real ones drew."""
    dock_w: Figure | None
    """None too where no dock held anything, or nobody says what docks hold."""


@dataclass(frozen=True, slots=True)
class _Discharge:
    """A stretch without a charger, less its means: a row for each reading that is used."""

    rows: Floats
    """Seconds, metres, newton seconds, dock seconds."""
    drawn_wh: Floats


def energy_of(logs: list[tuple[VehicleLog, list[Reflown]]], capacity_wh: float) -> EnergyFigures:
    """Fits the battery's level over each stretch in which it did not rise, as at a charger or when it was changed.

    A level and not its fall from reading to reading: that would be little more than the readings' own steps.
    """
    stretches = [it for log, flown in logs for it in _discharges(log, flown, capacity_wh)]
    if not stretches:
        return EnergyFigures(None, None, None, None)
    rows = np.concatenate([it.rows for it in stretches])
    drawn_wh = np.concatenate([it.drawn_wh for it in stretches])
    resolution_wh = capacity_wh * max(_step(log.battery.fractions) for log, _ in logs)
    docks = [3] if rows[:, 3].any() else []

    def fitted(moving: int) -> list[Figure] | None:
        used = [0, moving, *docks]
        units = ["Wh/s", "Wh", "Wh/s"][: len(used)]
        return regression(rows[:, used], drawn_wh, units, len(stretches), resolution_wh)

    by_way, by_force = fitted(1), fitted(2)
    better = by_force or by_way
    return EnergyFigures(
        None if better is None else better[0].scaled(_S_PER_H, "W"),
        None if by_way is None else by_way[1].scaled(1, "Wh/m"),
        None if by_force is None else by_force[1].scaled(_S_PER_H, "W/N"),
        better[2].scaled(_S_PER_H, "W") if better is not None and docks else None,
    )


def _discharges(log: VehicleLog, flown: list[Reflown], capacity_wh: float) -> Iterator[_Discharge]:
    battery = log.battery
    times_s, levels = battery.times_s, battery.fractions
    if len(times_s) < 2:
        return
    step = _step(levels)
    rises = np.flatnonzero(np.diff(levels) > 2 * step) + 1
    for part in np.split(np.arange(len(times_s)), rises):
        if len(part) < 2:
            continue
        begin_s, end_s = times_s[part[0]], times_s[part[-1]]
        fell = levels[part[0]] - levels[part[-1]]
        period_s = max(PERIOD_S, 2 * step * (end_s - begin_s) / fell) if fell > 0 else PERIOD_S
        wanted_s = np.arange(begin_s, end_s + 1e-9, period_s)
        used = np.unique(np.minimum(np.searchsorted(times_s, wanted_s), part[-1]))
        if len(used) < 3:
            continue
        at_s = times_s[used]
        columns = [at_s - begin_s, way_at(log, at_s), impulse_at(flown, at_s), log.dock_seconds(at_s)]
        rows, drawn_wh = np.array(columns).T, -levels[used] * capacity_wh
        yield _Discharge(rows - rows.mean(axis=0), drawn_wh - drawn_wh.mean())


def _step(fractions: Floats) -> float:
    """The readings' step: the least change between two; 0 for readings that never change."""
    changes = np.abs(np.diff(fractions))
    changes = changes[changes > 1e-9]
    return float(changes.min()) if len(changes) else 0.0
