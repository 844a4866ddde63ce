"""Currents from NetCDF files, classic and HDF5, and from a scenario's block: the same as from the equivalent CSV.

On triangles: linear fields by their formula, others by scipy's interpolation, and edges, land and borders by hand.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scenario_files import POOL_FILE
from scipy.interpolate import LinearNDInterpolator
from scipy.spatial import Delaunay

from agents.mussel.body import Body
from agents.water.water_current import WaterCurrent, parse_water_current
from apad_bridge.assembly import fleet_parts
from apad_bridge.assembly.flight_config import flight_config
from apad_bridge.scenario.area.local_frame import LocalFrame
from apad_bridge.scenario.errors import ScenarioError
from apad_bridge.scenario.loader import from_data, load, resolve
from apad_bridge.scenario.schema import Scenario
from apad_bridge.scenario.starts import starts_of
from apad_bridge.scenario.water.currents import current_text, read_current

netCDF4 = pytest.importorskip("netCDF4")
FRAME = LocalFrame(43.93, 15.44)
POOL = POOL_FILE


def written(path: Path, kind: str, norths: list[float], easts: list[float], **names: str) -> Path:
    """Two times an hour apart, one depth; north velocity row / 10 + hour, east velocity column / 10; a corner is land."""
    row, column = names.get("row", "latitude"), names.get("column", "longitude")
    hour, along, across = np.ix_(range(2), range(len(easts)), range(len(norths)))
    axes = {"time": [1000.0, 1001.0], "depth": [1.5], column: easts, row: norths}
    velocities = {"vo": across / 10 + hour + 0 * along, "uo": along / 10 + 0 * (across + hour)}
    with netCDF4.Dataset(str(path), "w", format=kind) as data:
        for name, values in axes.items():
            data.createDimension(name, len(values))
            data.createVariable(name, "f8", (name,))[:] = values
        data["time"].units = "hours since 1950-01-01"
        for name, values in velocities.items():
            values[:, 0, 0] = -999.0
            data.createVariable(name, "f8", tuple(axes), fill_value=-999.0)[:] = values[:, None]
    return path


@pytest.mark.parametrize("kind", ["NETCDF3_CLASSIC", "NETCDF4"])
def test_both_formats_give_the_same_field(tmp_path: Path, kind: str) -> None:
    path = written(tmp_path / "model.nc", kind, [0.0, 100.0], [0.0, 50.0], row="north_m", column="east_m")
    stream = read_current(path, FRAME)
    metre = 1_000_000
    assert list(stream.seconds) == [0, 3600] and list(stream.depths_um) == [1_500_000]
    assert stream.velocity_um_s(100 * metre, 50 * metre, 0, 0) == (100_000, 100_000)
    assert stream.velocity_um_s(100 * metre, 0, 0, 1800) == (600_000, 0)
    assert stream.velocity_um_s(0, 0, 0, 3600) == (0, 0)  # land


def test_degrees_become_metres_and_what_is_far_is_left_out(tmp_path: Path) -> None:
    """One degree of latitude is some 111 km; 0.01 is 1.11 km."""
    path = written(tmp_path / "model.nc", "NETCDF4", [43.93, 43.94, 44.93], [15.44, 15.45])
    field = parse_water_current(current_text(path, FRAME)).fields[0]
    assert np.array(field.norths_um) / 1e6 == pytest.approx([0, 1111.1], abs=1.0)
    assert field.easts_um[1] / 1e6 == pytest.approx(802.5, abs=1.5)


def problem_with(path: Path, frame: LocalFrame) -> str:
    with pytest.raises((OSError, ValueError)) as told:
        read_current(path, frame)
    return str(told.value)


def empty(path: Path) -> None:
    with netCDF4.Dataset(str(path), "w") as data:
        data.createDimension("time", 1)


@pytest.mark.parametrize(
    ("write", "problem"),
    [
        (lambda it: it.write_bytes(b"not a file of that kind"), "NetCDF"),
        (lambda it: written(it, "NETCDF4", [10.0, 11.0], [0.0, 1.0]), "no point lies within 20 km"),
        (empty, "no variable is called north_m_s"),
    ],
    ids=["junk", "far", "empty"],
)
def test_what_is_no_current_is_told(tmp_path: Path, write: Callable[[Path], object], problem: str) -> None:
    write(tmp_path / "model.nc")
    assert problem in problem_with(tmp_path / "model.nc", FRAME)


Floats = NDArray[np.float64]


@dataclass
class MeshFile:
    """A file as SHYFEM writes it, or by UGRID. Velocities have an axis of time, one of depth if `levels`, and nodes."""

    nodes_m: Any
    triangles: Any
    north_m_s: Any
    east_m_s: Any
    levels: tuple[float, ...] = ()
    is_ugrid: bool = False
    start_index: int | None = None
    first_node: int = 1
    is_transposed: bool = False
    faces: Any = None

    def write(self, path: Path) -> Path:
        places = np.array([FRAME.to_geographic(*it) for it in np.asarray(self.nodes_m, dtype=float)])
        faces = np.asarray(self.triangles if self.faces is None else self.faces) + self.first_node
        north, east, table, node, element = (
            ("Mesh_y", "Mesh_x", "Mesh_faces", "nNode", "nFace")
            if self.is_ugrid
            else ("latitude", "longitude", "element_index", "node", "element")
        )
        order = ("vertex", element) if self.is_transposed else (element, "vertex")
        speeds, times = np.array([self.east_m_s, self.north_m_s]), 600.0 * np.arange(len(self.north_m_s))
        axes = ("time", node, *["level"] * bool(self.levels))
        names = {"standard_name": "latitude"}, {"standard_name": "longitude"}
        of_level = {"standard_name": "depth", "description": "bottom of vertical layers"}
        of_faces = {} if self.start_index is None else {"start_index": np.int32(self.start_index)}
        variables: list[tuple[str, str, tuple[str, ...], Any, dict[str, Any]]] = [
            *(
                (it, "f8", (node,), at, name)
                for it, at, name in zip((north, east), places.T, names, strict=True)
            ),
            (table, "i4", order, faces.T if self.is_transposed else faces, of_faces),
            ("time", "f8", ("time",), times, {"units": "seconds since 2012-01-01 00:00:00 UTC"}),
            *(
                (it, "f8", axes, np.moveaxis(own, 1, -1) if self.levels else own, {})
                for it, own in zip(("u_velocity", "v_velocity"), speeds, strict=True)
            ),
        ]
        if self.is_ugrid:
            mesh = {"cf_role": "mesh_topology", "face_node_connectivity": table, "face_dimension": element}
            variables.append(("Mesh", "i4", (), 0, {**mesh, "node_coordinates": f"{east} {north}"}))
        if self.levels:
            variables.append(("level", "f4", ("level",), self.levels, of_level))
        sizes = {"level": len(self.levels), node: len(places), element: len(faces), "vertex": faces.shape[1]}
        with netCDF4.Dataset(str(path), "w") as data:
            for name, size in {**sizes, "time": None}.items():
                data.createDimension(name, size)
            for name, kind, along, values, told in variables:
                data.createVariable(name, kind, along, fill_value=-999)[:] = values
                data[name].setncatts(told)
        return path


def mesh(seed: int, along: int = 13, half_m: float = 300.0) -> tuple[Floats, Any]:
    """Nodes of a square about the origin, the inner ones shaken, and Delaunay's triangles, each either way round."""
    random = np.random.default_rng(seed)
    line = np.linspace(-half_m, half_m, along)
    places = np.stack(np.meshgrid(line, line), axis=-1).reshape(-1, 2)
    is_inner = (np.abs(places) < half_m).all(axis=1)
    places[is_inner] += random.uniform(-0.35, 0.35, (is_inner.sum(), 2)) * (line[1] - line[0])
    triangles = Delaunay(places).simplices
    turned = random.random(len(triangles)) < 0.5
    triangles[turned] = triangles[turned][:, ::-1]
    return places, triangles


def velocity_m_s(
    stream: WaterCurrent, north_m: float, east_m: float, depth_m: float = 0, second: int = 0
) -> list[float]:
    um = (round(it * 1e6) for it in (north_m, east_m, depth_m))
    return [it / 1e6 for it in stream.velocity_um_s(*um, second)]


@pytest.mark.parametrize("is_ugrid", [False, True])
def test_a_linear_field_on_triangles_is_its_formula(tmp_path: Path, is_ugrid: bool) -> None:
    """Everywhere in the mesh, and at each time: 0.1 + n / 2000 - e / 4000 to north, and half of it to east at 600 s."""
    places, triangles = mesh(1)
    north = 0.1 + places[:, 0] / 2000 - places[:, 1] / 4000
    file = MeshFile(places, triangles, [north, 0 * north], [0 * north, north / 2], is_ugrid=is_ugrid)
    file.first_node = 0 if is_ugrid else 1
    stream = read_current(file.write(tmp_path / "shyfem.nc"), FRAME)
    assert list(stream.seconds) == [0, 600]
    for n, e in np.random.default_rng(2).uniform(-300, 300, (500, 2)):
        there = 0.1 + n / 2000 - e / 4000
        assert velocity_m_s(stream, n, e) == pytest.approx([there, 0], abs=2e-6)
        assert velocity_m_s(stream, n, e, second=600) == pytest.approx([0, there / 2], abs=2e-6)


def test_a_stirred_field_is_that_of_an_independent_interpolation(tmp_path: Path) -> None:
    """At each crossing of the lines. Between them the two differ by far less than the mesh does from the field itself."""
    places, triangles = mesh(3)

    def field(places: Floats) -> Floats:
        n, e = places.T / 60
        return np.column_stack((np.sin(n) * np.cos(e), np.cos(n + 0.3) * np.sin(e)))

    speeds = field(places)
    path = MeshFile(places, triangles, [speeds[:, 0]], [speeds[:, 1]]).write(tmp_path / "shyfem.nc")
    exact = LinearNDInterpolator(Delaunay(places), speeds)
    stream = read_current(path, FRAME)
    lines = [(n / 1e6, e / 1e6) for n in stream.fields[0].norths_um for e in stream.fields[0].easts_um]
    assert len(lines) > 30**2
    assert np.array([velocity_m_s(stream, *it) for it in lines]) == pytest.approx(exact(lines), abs=2e-6)
    between = np.random.default_rng(4).uniform(-300, 300, (2000, 2))
    off = np.abs(np.array([velocity_m_s(stream, *it) for it in between]) - exact(between))
    assert off.max() < 0.1 and off.mean() < 0.2 * np.abs(exact(between) - field(between)).mean()


def test_the_order_and_the_first_number_of_nodes_do_not_matter(tmp_path: Path) -> None:
    places, triangles = mesh(5, along=6)
    speeds = np.random.default_rng(6).uniform(-1, 1, (2, len(places)))

    def text(order: Any, **how: Any) -> list[list[float]]:
        new_number = np.argsort(order)
        file = MeshFile(places[order], new_number[triangles], [speeds[0][order]], [speeds[1][order]], **how)
        rows = current_text(file.write(tmp_path / "mesh.nc"), FRAME).splitlines()[1:]
        return [[float(cell) for cell in row.split(",")] for row in rows]

    same, other = np.arange(len(places)), np.random.default_rng(7).permutation(len(places))
    first = text(same)
    for how in (
        {"first_node": 0},
        {"start_index": 1},
        {"first_node": 0, "start_index": 0},
        {"is_transposed": True},
        {"is_ugrid": True, "first_node": 0},
        {"is_ugrid": True, "first_node": 1, "start_index": 1},
        {"is_ugrid": True, "first_node": 0, "is_transposed": True},
    ):
        assert text(same, **how) == first
        assert np.allclose(text(other, **how), first, atol=2e-6)


TRIANGLE = ([(0, 0), (100, 0), (0, 100)], [(0, 1, 2)])


STILL = np.zeros((1, 2, 3))
WIDE = {"is_ugrid": True, "first_node": 0, "faces": [[0, 1, 2, -9]]}
"""A table of faces that is wide enough for squares."""
ON_TRIANGLE: dict[str, tuple[MeshFile, list[float], dict[tuple[float, ...], list[float]]]] = {
    **{
        f"a dry node, {missing}, is still water: half of the speed half-way there": (
            MeshFile(*TRIANGLE, [[0.4, 0.4, missing]], [[0.0, 0.2, 0.2]]),
            [0],
            {(0, 50): [0.2, 0.1], (0, 100): [0, 0.2]},
        )
        for missing in (-999.0, np.nan)
    },
    "levels are the middles of their layers, to 2 m and to 6 m, and a layer under the bottom is missing": (
        MeshFile(*TRIANGLE, [[[0.4, 0.4, 0.4], [0.1, 0.1, -999.0]]], STILL, levels=(2, 6)),
        [1, 4],
        {(0, 0, 2): [0.3, 0], (0, 100, 5): [0, 0]},
    ),
    # (100, 80) lies beyond (60, 40) of the long side, (-40, 30) beyond another side, and far north is beyond a corner.
    "outside the triangles the nearest point counts": (
        MeshFile(*TRIANGLE, [[0.0, 0.4, 0.2]], [[0.1, 0.1, 0.1]], **WIDE),
        [0],
        {(100, 80): [0.6 * 0.4 + 0.4 * 0.2, 0.1], (-40, 30): [0.06, 0.1], (5000, 0): [0.4, 0.1]},
    ),
}
"""A file, the depths that it is read at, and velocities at places of it."""


@pytest.mark.parametrize(("file", "depths_m", "wanted"), ON_TRIANGLE.values(), ids=ON_TRIANGLE)
def test_a_triangle_by_hand(
    tmp_path: Path, file: MeshFile, depths_m: list[float], wanted: dict[tuple[float, ...], list[float]]
) -> None:
    stream = read_current(file.write(tmp_path / "mesh.nc"), FRAME)
    assert [it / 1e6 for it in stream.depths_um] == depths_m
    for place, velocity in wanted.items():
        assert velocity_m_s(stream, *place) == pytest.approx(velocity, abs=2e-6), place


def test_land_between_has_the_velocity_of_the_nearest_water(tmp_path: Path) -> None:
    """A square of 300 m with a square island of 100 m, and the area's origin off its middle: the nearest shore counts."""
    middle = np.array([13.0, 7.0])
    ring = [
        middle + np.array([s * n, s * e]) for s in (50, 150) for n, e in ((-1, -1), (-1, 1), (1, 1), (1, -1))
    ]
    triangles = [
        it for n in range(4) for it in ((n, (n + 1) % 4, 4 + n), ((n + 1) % 4, 4 + (n + 1) % 4, 4 + n))
    ]
    north, east = np.array(ring).T / 1000
    path = MeshFile(ring, triangles, [north], [east]).write(tmp_path / "mesh.nc")
    rows = np.array(
        [[float(it) for it in row.split(",")] for row in current_text(path, FRAME).splitlines()[1:]]
    )
    off = rows[:, 2:4] - middle
    sizes = np.abs(off)
    on_land = (sizes.max(axis=1) < 49) & (
        np.abs(sizes[:, 0] - sizes[:, 1]) > 0.01
    )  # else two shores are as near
    nearer = on_land[:, None] & (sizes == sizes.max(axis=1, keepdims=True))
    shores = middle + np.where(nearer, 50 * np.sign(off), off)
    assert on_land.sum() >= 4 and rows[:, 4:6] == pytest.approx(shores / 1000, abs=2e-6)


def test_lines_are_close_at_the_origin_and_few_far_off(tmp_path: Path) -> None:
    """A sea of 60 km, with edges of 50 m at the area and of kilometres far off, each hour of a day."""
    random = np.random.default_rng(8)
    away = 10 ** random.uniform(1.3, 4.4, 4000)
    turn = random.uniform(0, 2 * np.pi, 4000)
    places = np.column_stack((away * np.cos(turn), away * np.sin(turn)))
    north = np.sin(places[:, 0] / 500)
    path = MeshFile(places, Delaunay(places).simplices, [north] * 25, [north] * 25).write(tmp_path / "sea.nc")
    header, *rows = current_text(path, FRAME).splitlines()
    first = [row for row in rows if row.startswith("0,")]
    assert len(rows) == 25 * len(first) <= 200_000
    # Agents read one hour of it: a table with all takes ten seconds.
    stream = parse_water_current("\n".join([header, *first]))
    lines = np.array(stream.fields[0].norths_um) / 1e6
    assert lines[0] == -20_000 and lines[-1] == 20_000
    widths = np.diff(lines)
    assert widths[np.abs(lines[:-1]) < 30].max() < 10 and widths.max() > 1000
    exact = LinearNDInterpolator(Delaunay(places), north)
    for n, e in random.uniform(-100, 100, (200, 2)):
        assert velocity_m_s(stream, n, e)[0] == pytest.approx(exact(n, e), abs=0.02)


@pytest.mark.parametrize(
    ("change", "problem"),
    [
        (
            lambda it: setattr(it, "start_index", 0),
            "it names nodes beyond the 3 of latitude: see start_index",
        ),
        (lambda it: setattr(it, "faces", [[0, 1, 7]]), "it names nodes beyond the 3"),
        (lambda it: setattr(it, "faces", [[0, 1, 2, 2]]), "each face needs three nodes"),
        (lambda it: setattr(it, "faces", [[0, -10, 2]]), "each face needs three nodes"),
        (lambda it: setattr(it, "faces", [[0, 1, 1]]), "no triangle lies within 20 km"),
        (lambda it: setattr(it, "nodes_m", [(9e4, 0), (9e4, 9), (8e4, 0)]), "no triangle lies within 20 km"),
        (lambda it: setattr(it, "north_m_s", [[0.1, 0.1, 50.0]]), "must be a number within"),
        (lambda it: setattr(it, "levels", tuple(range(1, 40_001))), "points are needed .* cut the file"),
    ],
)
def test_what_is_no_mesh_is_told(tmp_path: Path, change: Callable[[MeshFile], None], problem: str) -> None:
    file = MeshFile(*TRIANGLE, [[0.1] * 3], [[0.1] * 3])
    change(file)
    if file.levels:
        file.north_m_s = file.east_m_s = np.zeros((1, len(file.levels), 3))
    told = problem_with(file.write(tmp_path / "mesh.nc"), FRAME)
    assert re.search(problem, told), told


def on_faces(data: Any) -> None:
    """FVCOM has its velocities there."""
    for name in ("u", "v"):
        data.createVariable(name, "f8", ("time", "nFace"))[:] = 0.1


@pytest.mark.parametrize(
    ("is_ugrid", "change", "told"),
    [
        (True, lambda it: it.renameVariable("Mesh_faces", "x"), "lacks its variable Mesh_faces"),
        (True, lambda it: it["Mesh"].delncattr("node_coordinates"), "need latitude and longitude"),
        (False, lambda it: it.renameVariable("latitude", "y"), "need latitude and longitude"),
        (True, on_faces, "an axis 'nFace' is not known"),
        (
            False,
            lambda it: setattr(it["level"], "standard_name", "ocean_sigma_coordinate"),
            "level has shares of the depth",
        ),
    ],
    ids=["no triangles", "no coordinates", "no latitude", "velocities on faces", "levels by shares"],
)
def test_a_mesh_needs_its_places_and_velocities_on_its_nodes(
    tmp_path: Path, is_ugrid: bool, change: Callable[[Any], object], told: str
) -> None:
    file = MeshFile(*TRIANGLE, STILL, STILL, levels=(0.5, 1.0), is_ugrid=is_ugrid, first_node=0)
    with netCDF4.Dataset(str(file.write(tmp_path / "mesh.nc")), "a") as data:
        change(data)
    assert told in problem_with(tmp_path / "mesh.nc", FRAME)


def test_the_other_side_of_the_earth_is_not_near(tmp_path: Path) -> None:
    """Seen along the vertical of a place at the equator, it lies behind that place."""
    path = MeshFile(*TRIANGLE, [[0.1] * 3], [[0.1] * 3]).write(tmp_path / "mesh.nc")
    with netCDF4.Dataset(str(path), "a") as data:
        data["latitude"][:] -= FRAME.latitude_deg
    assert read_current(path, LocalFrame(0.0, FRAME.longitude_deg))
    assert "no triangle lies within" in problem_with(path, LocalFrame(0.0, FRAME.longitude_deg - 180))


def tidal(**current: Any) -> Scenario:
    data = resolve(load(POOL))
    data["fleet"]["drift"] = {"mode": "physical"}
    data["water"] = {"current": current}
    return from_data(data, "tidal")


def test_a_body_drifts_by_its_depth_and_state() -> None:
    """On the bottom nothing moves the aMussel. It rises 3 m in a minute through 0.3 m/s, whole at the surface and a third
    at the bottom: it drifts (0.3 + 0.1) / 2 x 60 = 12 m, in steps of a second of mission time, because theta is 1."""
    tide = {"period_h": 4e3, "north_m_s": 0.3, "east_m_s": 0.0, "north_phase_deg": 90}
    scenario = replace(tidal(tides=[tide], profile=[[0, 1], [3, 1 / 3]]), theta=1)
    config = fleet_parts.fleet_config(flight_config(scenario)).maker().config(1)
    born = fleet_parts.initial_states(scenario, starts_of(scenario))[1]
    body = Body(1, config.water, replace(born, north_um=0, east_um=0), 0)
    assert body.drift_due_ms is None
    body.run_buoyancy(body.buoyancy.FLOAT, 0)
    for now_ms in range(1000, 60_001, 1000):
        assert body.drift_due_ms == now_ms
        body.drift(now_ms)
    assert body.north_um / 1e6 == pytest.approx(12.0, abs=0.11)
    body.settle_depth(60_000)
    body.drift(61_000)
    assert body.drift_due_ms == 62_000


@pytest.mark.parametrize(
    ("current", "drift", "told"),
    [
        ({"file": "c.csv"}, {}, None),
        ({"file": "c.csv"}, {"current_file": "c.csv"}, r"water\.current: .*leave one out"),
        ({"file": "c.csv", "steady_m_s": [0.1, 0]}, {}, r"water\.current\.steady_m_s: .*leave one out"),
        ({"profile": [[3, 1], [0, 1]]}, {}, "profile must go down"),
    ],
    ids=["one current", "two currents", "two kinds of a current", "a profile that goes up"],
)
def test_there_is_one_current_at_most(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    current: dict[str, Any],
    drift: dict[str, str],
    told: str | None,
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("c.csv").write_text("north_m,east_m,north_m_s,east_m_s\n0,0,0.1,0\n")
    with nullcontext() if told is None else pytest.raises(ScenarioError, match=told):
        data = resolve(tidal(**current))
        data["fleet"]["drift"] |= drift
        assert fleet_parts.fleet_config(flight_config(from_data(data, "one"))).current.csv is not None


def test_two_numbers_are_a_current_that_is_the_same_everywhere() -> None:
    data = resolve(load(POOL))
    data["fleet"]["drift"] = {"mode": "physical", "current_m_s": [0.05, -0.1]}
    for scenario in (from_data(resolve(tidal(steady_m_s=[0.05, -0.1])), "steady"), from_data(data, "drift")):
        stream = parse_water_current(fleet_parts.fleet_config(flight_config(scenario)).current.csv or "")
        found = {stream.velocity_um_s(*place, 2_000_000, 7) for place in ((0, 0), (30_000_000, -9_000_000))}
        assert found == {(50_000, -100_000)}
