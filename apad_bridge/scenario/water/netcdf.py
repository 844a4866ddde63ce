"""A NetCDF file of currents, cut to a scenario's area, as CSV.

netCDF4 reads both the classic format and the newer one on HDF5; scipy reads the classic format only.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import netCDF4
import numpy as np
from numpy.typing import NDArray

from apad_bridge.scenario.area.local_frame import LocalFrame

NORTH_NAMES = ("north_m_s", "vo", "v", "northward_sea_water_velocity", "sea_water_y_velocity")
EAST_NAMES = ("east_m_s", "uo", "u", "eastward_sea_water_velocity", "sea_water_x_velocity")
_AXES = {
    "time": ("time", "t", "ocean_time"),
    "depth": ("depth", "deptht", "lev", "z"),
    "row": ("latitude", "lat", "north_m"),
    "column": ("longitude", "lon", "east_m"),
}
_UNITS_S = {"seconds": 1, "minutes": 60, "hours": 3600, "days": 86_400}
_MOST_POINTS = 200_000
_MAX_OFFSET_M = 20_000.0
"""Points farther than this from the area's origin, to north or to east, are left out."""


def csv_of(path: Path, frame: LocalFrame) -> str:
    """Returns `time_s,depth_m,north_m,east_m,north_m_s,east_m_s`. Raises OSError, or ValueError with the problem."""
    with netCDF4.Dataset(str(path)) as data:
        return _csv(data.variables, frame)


def _csv(variables: Any, frame: LocalFrame) -> str:
    north, east = _find_variable(variables, NORTH_NAMES), _find_variable(variables, EAST_NAMES)
    if north.dimensions != east.dimensions:
        raise ValueError(f"{north.name} and {east.name} have other dimensions")
    axes = {_axis_of(name): name for name in north.dimensions}
    if not {"row", "column"} <= axes.keys():
        raise ValueError("the velocities need an axis of latitude or north_m, and one of longitude or east_m")
    seconds = _seconds(variables[axes["time"]]) if "time" in axes else [0]
    depths = [0.0] if "depth" not in axes else [abs(float(it)) for it in variables[axes["depth"]][:]]
    norths, easts = _metres(variables[axes["row"]], variables[axes["column"]], frame)
    rows, columns = (np.flatnonzero(np.abs(it) <= _MAX_OFFSET_M) for it in (norths, easts))
    points = len(rows) * len(columns) * len(seconds) * len(depths)
    if points == 0:
        raise ValueError(f"no point lies within {_MAX_OFFSET_M / 1000:g} km of the area's origin")
    if points > _MOST_POINTS:
        raise ValueError(f"{points} points lie near the area, at most {_MOST_POINTS} are taken: cut the file")
    speeds = [_ordered(it, rows, columns) for it in (north, east)]
    lines = ["time_s,depth_m,north_m,east_m,north_m_s,east_m_s"]
    for (t, z, row, column), north_m_s in np.ndenumerate(speeds[0]):
        where = f"{seconds[t]},{depths[z]:.6g},{norths[rows[row]]:.3f},{easts[columns[column]]:.3f}"
        lines.append(f"{where},{north_m_s:.6g},{speeds[1][t, z, row, column]:.6g}")
    return "\n".join(lines)


def _find_variable(variables: Any, names: tuple[str, ...]) -> Any:
    for name in names:
        if name in variables:
            return variables[name]
    for variable in variables.values():
        if getattr(variable, "standard_name", None) in names:
            return variable
    raise ValueError(f"no variable is called {', '.join(names)}")


def _axis_of(dimension: str) -> str:
    for axis, names in _AXES.items():
        if dimension in names:
            return axis
    raise ValueError(
        f"an axis {dimension!r} is not known: {', '.join(n for names in _AXES.values() for n in names)}"
    )


def _seconds(time: Any) -> list[int]:
    unit = str(getattr(time, "units", "seconds")).split()[0]
    if unit not in _UNITS_S:
        raise ValueError(f"time is in {unit!r}, not in {', '.join(_UNITS_S)}")
    values = np.asarray(time[:], dtype=np.float64) * _UNITS_S[unit]
    return [round(float(it)) for it in values - values[0]]


def _metres(row: Any, column: Any, frame: LocalFrame) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Returns the axes' points in local NED; converts degrees along the origin's meridian and parallel."""
    rows, columns = (np.asarray(it[:], dtype=np.float64) for it in (row, column))
    if rows.ndim != 1 or columns.ndim != 1:
        raise ValueError("needs the axes of a grid, not of a curved one")
    if row.name == "north_m":
        return rows, columns
    norths = np.array([frame.to_local(it, frame.longitude_deg)[0] for it in rows])
    easts = np.array([frame.to_local(frame.latitude_deg, it)[1] for it in columns])
    return norths, easts


def _ordered(variable: Any, rows: NDArray[np.intp], columns: NDArray[np.intp]) -> NDArray[np.float64]:
    """Reads a variable with axes (time, depth, row, column) and 0 where there is no water."""
    read: Any = variable[:]
    values = np.asarray(read.filled(0.0) if hasattr(read, "filled") else read, dtype=np.float64)
    values = np.where(np.isfinite(values), values, 0.0)
    present = [_axis_of(name) for name in variable.dimensions]
    wanted = [axis for axis in _AXES if axis in present]
    values = np.transpose(values, [present.index(axis) for axis in wanted])
    for n, axis in enumerate(_AXES):
        if axis not in present:
            values = np.expand_dims(values, n)
    cut: NDArray[np.float64] = values[:, :, rows][:, :, :, columns]
    return cut
