"""Currents from NetCDF files, classic and HDF5, and from a scenario's block: the same as from the equivalent CSV."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scenario_files import POOL_FILE

from agents.mussel.body import Body
from agents.water.stream import parse_stream
from apad_bridge.assembly import fleet_parts
from apad_bridge.assembly.flight_config import flight_config
from apad_bridge.scenario.area.local_frame import LocalFrame
from apad_bridge.scenario.errors import ScenarioError
from apad_bridge.scenario.loader import from_data, load, resolve
from apad_bridge.scenario.schema import Scenario
from apad_bridge.scenario.starts import starts_of
from apad_bridge.scenario.water.currents import current_text, problem_with_current, read_current

netCDF4 = pytest.importorskip("netCDF4")
FRAME = LocalFrame(43.93, 15.44)
POOL = POOL_FILE


def written(path: Path, kind: str, norths: list[float], easts: list[float], **names: str) -> Path:
    """Two times an hour apart, one depth; north velocity row / 10 + hour, east velocity column / 10; a corner is land."""
    row, column = names.get("row", "latitude"), names.get("column", "longitude")
    with netCDF4.Dataset(str(path), "w", format=kind) as data:
        for name, size in (("time", 2), ("depth", 1), (column, len(easts)), (row, len(norths))):
            data.createDimension(name, size)
        time = data.createVariable("time", "f8", ("time",))
        time.units = "hours since 1950-01-01"
        time[:] = [1000.0, 1001.0]
        data.createVariable("depth", "f8", ("depth",))[:] = [1.5]
        data.createVariable(row, "f8", (row,))[:] = norths
        data.createVariable(column, "f8", (column,))[:] = easts
        dimensions = ("time", "depth", column, row)
        v = data.createVariable("vo", "f8", dimensions, fill_value=-999.0)
        u = data.createVariable("uo", "f8", dimensions, fill_value=-999.0)
        for t in range(2):
            for c in range(len(easts)):
                v[t, 0, c, :] = np.arange(len(norths)) / 10 + t
                u[t, 0, c, :] = c / 10
        v[:, 0, 0, 0] = -999.0
        u[:, 0, 0, 0] = -999.0
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
    stream = parse_stream(current_text(path, FRAME))
    norths = stream.fields[0].norths_um
    assert len(norths) == 2
    assert norths[0] == 0 and norths[1] / 1e6 == pytest.approx(1111.1, abs=1.0)
    assert stream.fields[0].easts_um[1] / 1e6 == pytest.approx(802.5, abs=1.5)


def test_what_is_no_current_is_told(tmp_path: Path) -> None:
    (tmp_path / "junk.nc").write_bytes(b"not a file of that kind")
    assert "NetCDF" in problem_with_current(tmp_path / "junk.nc", FRAME)
    far = written(tmp_path / "far.nc", "NETCDF4", [10.0, 11.0], [0.0, 1.0])
    assert "no point lies within 20 km" in problem_with_current(far, FRAME)
    with netCDF4.Dataset(str(tmp_path / "empty.nc"), "w") as data:
        data.createDimension("time", 1)
    assert "no variable is called north_m_s" in problem_with_current(tmp_path / "empty.nc", FRAME)


def tidal(**current: Any) -> Scenario:
    data = resolve(load(POOL))
    data["fleet"]["drift"] = {"mode": "physical"}
    data["water"] = {"current": current}
    return from_data(data, "tidal")


def test_a_body_drifts_by_its_depth_and_state() -> None:
    """On the bottom nothing moves the aMussel. It rises 3 m in a minute through 0.3 m/s, whole at the surface and a third
    at the bottom: it drifts (0.3 + 0.1) / 2 x 60 = 12 m, in steps of a second of mission time, because theta is 1."""
    tide = {"period_h": 4e3, "north_m_s": 0.3, "east_m_s": 0.0, "north_phase_deg": 90}
    scenario = tidal(tides=[tide], profile=[[0, 1], [3, 1 / 3]])
    data = resolve(scenario)
    data["theta"] = 1
    scenario = from_data(data, "theta 1")
    config = fleet_parts.fleet_config(flight_config(scenario)).maker().config(1)
    born = fleet_parts.initial_states(scenario, starts_of(scenario))[1]
    body = Body(1, config.water, 0, 0, 0, born.depth_um, born.buoyancy, False, 0)
    assert body.drift_due_ms is None
    body.run_buoyancy(body.buoyancy.FLOAT, 0)
    for now_ms in range(1000, 60_001, 1000):
        assert body.drift_due_ms == now_ms
        body.drift(now_ms)
    assert body.north_um / 1e6 == pytest.approx(12.0, abs=0.11)
    body.settle_depth(60_000)
    body.drift(61_000)
    assert body.drift_due_ms == 62_000


def test_two_currents_contradict_each_other(tmp_path: Path) -> None:
    (tmp_path / "c.csv").write_text("north_m,east_m,north_m_s,east_m_s\n0,0,0.1,0\n")
    data = resolve(tidal(file=str(tmp_path / "c.csv")))
    assert fleet_parts.fleet_config(flight_config(from_data(data, "one"))).current.csv is not None
    data["fleet"]["drift"]["current_file"] = str(tmp_path / "c.csv")
    with pytest.raises(ScenarioError, match=r"water\.current: .*leave one out"):
        from_data(data, "two")


def test_two_numbers_are_a_current_that_is_the_same_everywhere() -> None:
    in_water = flight_config(from_data(resolve(tidal(steady_m_s=[0.05, -0.1])), "steady"))
    data = resolve(load(POOL))
    data["fleet"]["drift"] = {"mode": "physical", "current_m_s": [0.05, -0.1]}
    for config in (in_water, flight_config(from_data(data, "drift"))):
        text = fleet_parts.fleet_config(config).current.csv
        assert text is not None
        for north_um, east_um in ((0, 0), (30_000_000, -9_000_000)):
            assert parse_stream(text).velocity_um_s(north_um, east_um, 2_000_000, 7) == (50_000, -100_000)


def test_two_numbers_beside_a_file_are_two_currents(tmp_path: Path) -> None:
    (tmp_path / "c.csv").write_text("north_m,east_m,north_m_s,east_m_s\n0,0,0.1,0\n")
    with pytest.raises(ScenarioError, match=r"water\.current\.steady_m_s: .*leave one out"):
        tidal(file=str(tmp_path / "c.csv"), steady_m_s=[0.1, 0])


def test_a_profile_goes_down() -> None:
    with pytest.raises(ScenarioError, match="profile must go down"):
        tidal(profile=[[3, 1], [0, 1]])
