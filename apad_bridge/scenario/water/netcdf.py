"""A NetCDF file of currents, cut to a scenario's area, as CSV.

netCDF4 reads both the classic format and the newer one on HDF5; scipy reads the classic format only. Velocities lie on
a grid, or on the nodes of triangles: as SHYFEM writes them, with `element_index`
(https://github.com/shyfemcm/shyfemcm, src/tools/shynetcdf/netcdf.f90), or by the UGRID conventions 1.0
(https://ugrid-conventions.github.io/ugrid-conventions/), with a variable whose `cf_role` is `mesh_topology`.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from math import nan, remainder
from pathlib import Path
from typing import Any

import netCDF4
import numpy as np

from apad_bridge.scenario.area.local_frame import LocalFrame
from apad_bridge.scenario.water.mesh import Floats, Indices, TooManyPoints, resampling

NORTH_NAMES = ("north_m_s", "vo", "v", "v_velocity", "northward_sea_water_velocity", "sea_water_y_velocity")
EAST_NAMES = ("east_m_s", "uo", "u", "u_velocity", "eastward_sea_water_velocity", "sea_water_x_velocity")
_AXES = {
    "time": ("time", "t", "ocean_time"),
    "depth": ("depth", "deptht", "lev", "level", "z"),
    "row": ("latitude", "lat", "north_m"),
    "column": ("longitude", "lon", "east_m"),
}
_NODE = "node"
_SHYFEM_FACES = "element_index"
_UNITS_S = {"seconds": 1, "minutes": 60, "hours": 3600, "days": 86_400}
_MOST_POINTS = 200_000
_MOST_OF_MESH = 20_000
"""Points of a mesh at one time and depth."""
_MAX_OFFSET_M = 20_000.0
"""Points farther than this from the area's origin, to north or to east, are left out."""
_NEAR = f"within {_MAX_OFFSET_M / 1000:g} km of the area's origin"
_MAX_OFFSET_DEG = 10.0
"""Nodes farther than this belong to no triangle near the area. The other side of the earth has small metres too."""


def csv_of(path: Path, frame: LocalFrame) -> str:
    """Returns `time_s,depth_m,north_m,east_m,north_m_s,east_m_s`. Raises OSError, or ValueError with the problem."""
    with netCDF4.Dataset(str(path)) as data:
        return _csv(data.variables, frame)


def _csv(variables: Any, frame: LocalFrame) -> str:
    north, east = _find_variable(variables, NORTH_NAMES), _find_variable(variables, EAST_NAMES)
    if north.dimensions != east.dimensions:
        raise ValueError(f"{north.name} and {east.name} have other dimensions")
    mesh = _find_mesh(variables)
    axes = [_axis_of(name, mesh) for name in north.dimensions]
    named = dict(zip(axes, north.dimensions, strict=True))
    seconds = _seconds(variables[named["time"]]) if "time" in named else [0]
    depths = _depths(variables[named["depth"]]) if "depth" in named else [0.0]
    slices = len(seconds) * len(depths)
    if mesh is None:
        if not {"row", "column"} <= named.keys():
            raise ValueError(
                "the velocities need an axis of latitude or north_m, and one of longitude or east_m"
            )
        norths, easts = _metres(variables[named["row"]], variables[named["column"]], frame)
        rows, columns = (np.flatnonzero(np.abs(it) <= _MAX_OFFSET_M) for it in (norths, easts))
        points = len(rows) * len(columns) * slices
        if points == 0:
            raise ValueError(f"no point lies {_NEAR}")
        if points > _MOST_POINTS:
            raise ValueError(
                f"{points} points lie near the area, at most {_MOST_POINTS} are taken: cut the file"
            )
        norths, easts = norths[rows], easts[columns]
        speeds = [_ordered(it[:], axes, tuple(_AXES))[:, :, rows][:, :, :, columns] for it in (north, east)]
    else:
        if _NODE not in named:
            raise ValueError(f"{north.name} does not lie on the nodes of the triangles")
        most = min(_MOST_POINTS // slices, _MOST_OF_MESH)
        try:
            found = resampling(mesh.places_m(frame), mesh.triangles(), _MAX_OFFSET_M, most)
        except TooManyPoints as error:
            raise ValueError(f"{error} at each of {slices} times and depths: cut the file") from None
        if found is None:
            raise ValueError(f"no triangle lies {_NEAR}")
        norths, easts = found.norths_m, found.easts_m
        speeds = [
            np.concatenate([found.of_nodes(it) for it in _by_time(each, axes)]) for each in (north, east)
        ]
    lines = ["time_s,depth_m,north_m,east_m,north_m_s,east_m_s"]
    for (t, z, row, column), north_m_s in np.ndenumerate(speeds[0]):
        where = f"{seconds[t]},{depths[z]:.6g},{norths[row]:.3f},{easts[column]:.3f}"
        lines.append(f"{where},{north_m_s:.6g},{speeds[1][t, z, row, column]:.6g}")
    return "\n".join(lines)


@dataclass(frozen=True, slots=True)
class _Mesh:
    """The variables of a mesh of triangles."""

    faces: Any
    is_face_last: bool
    """True if the nodes of a triangle lie along the first axis of `faces`."""
    first_node: int | None
    """The number of the first node, if the file says it."""
    north: Any
    east: Any

    def places_m(self, frame: LocalFrame) -> Floats:
        """Returns (north, east) of each node in local NED (n x 2), NaN far away. Raises ValueError for no such place."""
        places = np.column_stack([np.asarray(it[:], dtype=np.float64) for it in (self.north, self.east)])
        if self.north.name == "north_m":
            return places
        for place in places:
            off = (place[0] - frame.latitude_deg, remainder(place[1] - frame.longitude_deg, 360.0))
            place[:] = frame.to_local(*place) if max(map(abs, off)) <= _MAX_OFFSET_DEG else nan
        return places

    def triangles(self) -> Indices:
        """Returns the nodes of each triangle from 0 on (n x 3). Raises ValueError for a face that is none."""
        read: Any = self.faces[:]
        numbers: Any = np.asarray(read.astype(np.int64).filled(-1) if hasattr(read, "filled") else read)
        if self.is_face_last:
            numbers = numbers.T
        if numbers.ndim != 2 or (numbers[:, :3] < 0).any() or (numbers[:, 3:] >= 0).any():
            raise ValueError(f"{self.faces.name}: each face needs three nodes")
        nodes: Indices = numbers[:, :3].astype(np.intp)
        nodes -= min(1, nodes.min()) if self.first_node is None else self.first_node
        count = len(self.north)
        if nodes.min() < 0 or nodes.max() >= count:
            raise ValueError(
                f"{self.faces.name}: it names nodes beyond the {count} of {self.north.name}: see start_index"
            )
        return nodes


def _find_mesh(variables: Any) -> _Mesh | None:
    """Returns the mesh of a file, by UGRID or as SHYFEM writes it; None for a grid. Raises ValueError for half a mesh."""
    topologies = [it for it in variables.values() if getattr(it, "cf_role", None) == "mesh_topology"]
    if topologies:
        (topology, *_) = topologies
        names = str(getattr(topology, "node_coordinates", "")).split()
        faces_name = str(getattr(topology, "face_node_connectivity", "face_node_connectivity"))
        face_axis = getattr(topology, "face_dimension", None)
    elif _SHYFEM_FACES in variables:
        names, faces_name, face_axis = [*_AXES["row"], *_AXES["column"]], _SHYFEM_FACES, "element"
    else:
        return None
    if faces_name not in variables:
        raise ValueError(f"the mesh lacks its variable {faces_name}")
    faces = variables[faces_name]
    north, east = (
        next((variables[it] for it in names if it in variables and _lies_along(variables[it], axis)), None)
        for axis in ("row", "column")
    )
    if north is None or east is None or north.ndim != 1 or north.dimensions != east.dimensions:
        raise ValueError("the nodes of the mesh need latitude and longitude, or north_m and east_m")
    # SHYFEM is a program in Fortran, which counts from 1 and does not say so; UGRID's default is 0.
    first_node = getattr(faces, "start_index", 0 if topologies else None)
    return _Mesh(
        faces, faces.dimensions[-1] == face_axis, None if first_node is None else int(first_node), north, east
    )


def _lies_along(variable: Any, axis: str) -> bool:
    return variable.name in _AXES[axis] or getattr(variable, "standard_name", None) in _AXES[axis]


def _find_variable(variables: Any, names: tuple[str, ...]) -> Any:
    for name in names:
        if name in variables:
            return variables[name]
    for variable in variables.values():
        if getattr(variable, "standard_name", None) in names:
            return variable
    raise ValueError(f"no variable is called {', '.join(names)}")


def _axis_of(dimension: str, mesh: _Mesh | None) -> str:
    if mesh is not None and (dimension,) == mesh.north.dimensions:
        return _NODE
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


def _depths(axis: Any) -> list[float]:
    """Returns depths in metres. SHYFEM's levels are the bottoms of layers; a velocity is that of a layer's middle."""
    if "sigma" in str(getattr(axis, "standard_name", "")):
        raise ValueError(f"{axis.name} has shares of the depth, not metres: write the file with depths")
    depths = [abs(float(it)) for it in axis[:]]
    if str(getattr(axis, "description", "")).startswith("bottom of"):
        return [(top + bottom) / 2 for top, bottom in pairwise([0.0, *depths])]
    return depths


def _metres(row: Any, column: Any, frame: LocalFrame) -> tuple[Floats, Floats]:
    """Returns the axes' points in local NED; converts degrees along the origin's meridian and parallel."""
    rows, columns = (np.asarray(it[:], dtype=np.float64) for it in (row, column))
    if rows.ndim != 1 or columns.ndim != 1:
        raise ValueError("needs the axes of a grid, not of a curved one")
    if row.name == "north_m":
        return rows, columns
    norths = np.array([frame.to_local(it, frame.longitude_deg)[0] for it in rows])
    return norths, np.array([frame.to_local(frame.latitude_deg, it)[1] for it in columns])


def _by_time(variable: Any, axes: list[str]) -> Iterator[Floats]:
    """Reads (1, depth, node) at one time after the other: a mesh of a whole sea is large."""
    at = axes.index("time") if "time" in axes else None
    for t in range(1 if at is None else variable.shape[at]):
        cut = tuple(slice(t, t + 1) if n == at else slice(None) for n in range(len(axes)))
        yield _ordered(variable[cut], axes, ("time", "depth", _NODE))


def _ordered(read: Any, axes: list[str], wanted: tuple[str, ...]) -> Floats:
    """Returns values with the wanted axes, in this order, and 0 where there is no water."""
    values = np.asarray(read.filled(0.0) if hasattr(read, "filled") else read, dtype=np.float64)
    values = np.where(np.isfinite(values), values, 0.0)
    values = np.transpose(values, [axes.index(axis) for axis in wanted if axis in axes])
    for n, axis in enumerate(wanted):
        if axis not in axes:
            values = np.expand_dims(values, n)
    return values
