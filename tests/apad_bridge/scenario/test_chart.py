"""Charts: their lines in local metres, and what is no chart, in one line by its key."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st
from scenario_files import POOL_FILE, SCENARIO_FILES

from agents.time_scale import MissionMs
from apad_bridge.analysis.replay.series import whole_view
from apad_bridge.events.run_events import RunBegan
from apad_bridge.records.journal import FORMAT_VERSION, Entry, JournalContents
from apad_bridge.scenario.area.chart import chart_of
from apad_bridge.scenario.area.local_frame import LocalFrame
from apad_bridge.scenario.errors import ScenarioError
from apad_bridge.scenario.loader import load, write_resolved

ORIGIN = load(POOL_FILE).area.origin
FRAME = LocalFrame.about(ORIGIN)


def degrees(north_m, east_m):
    latitude, longitude = FRAME.to_geographic(north_m, east_m)
    return [longitude, latitude]


def feature(kind, coordinates, **properties):
    return {
        "type": "Feature",
        "properties": properties,
        "geometry": {"type": kind, "coordinates": coordinates},
    }


def written(path: Path, *features) -> Path:
    path.write_text(json.dumps({"type": "FeatureCollection", "features": list(features)}))
    return path


PLACES = st.lists(st.tuples(*[st.floats(-5000, 5000)] * 2), min_size=2, max_size=6)


@given(points=PLACES, depth=st.none() | st.floats(0, 100))
def test_a_line_lies_where_the_map_of_its_author_has_it(tmp_path_factory, points, depth):
    path = tmp_path_factory.getbasetemp() / "chart.geojson"
    of = {} if depth is None else {"depth_m": depth}
    line = [degrees(*it) for it in points]
    written(path, feature("LineString", line, **of), feature("MultiPolygon", [[line, line]], **of))
    found = chart_of(str(path), ORIGIN)
    assert [it.depth_m for it in found] == [depth] * 3
    for drawn in found:
        for place, wanted in zip(drawn.points, points, strict=True):
            assert place == pytest.approx(wanted, abs=1e-3)


def scenario_with(tmp_path: Path, chart: str) -> Path:
    data = yaml.safe_load(POOL_FILE.read_text())
    data["fleet"]["start"] = str(SCENARIO_FILES / "pool.csv")
    data["area"] |= {"chart": chart, "fence": [[-5, -5], [33, -5], [33, 26], [-5, 26]]}
    path = tmp_path / "pool.yaml"
    path.write_text(yaml.safe_dump(data))
    return path


@pytest.mark.parametrize(
    ("text", "why"),
    [
        (None, "No such file or directory"),
        ("not json", "Expecting value"),
        ('{"type": "Point", "coordinates": [1, 2]}', "must hold lines or polygons, and holds a Point"),
        ('{"type": "LineString"}', "is no GeoJSON of lines: KeyError"),
        ('{"type": "LineString", "coordinates": [[1, 2]]}', "a line needs two positions or more"),
        (
            json.dumps(feature("LineString", [[1, 2], [3, 4]], depth_m="deep")),
            "depth_m must be a number of metres, not 'deep'",
        ),
    ],
)
def test_what_is_no_chart_is_said_in_one_line(tmp_path, text, why):
    if text is not None:
        (tmp_path / "chart.geojson").write_text(text)
    with pytest.raises(ScenarioError) as raised:
        load(scenario_with(tmp_path, "chart.geojson"))
    (line,) = raised.value.lines
    assert "area.chart" in line and "chart.geojson" in line and why in line


def test_the_page_has_the_chart_and_the_fence(tmp_path):
    written(tmp_path / "chart.geojson", feature("LineString", [degrees(0, 0), degrees(3, 4)], depth_m=2))
    scenario = load(scenario_with(tmp_path, "chart.geojson"))
    began = RunBegan(FORMAT_VERSION, "chart", 1, 1, 60.0, 0.8, 0.99, [])
    data = whole_view(scenario, JournalContents([Entry(MissionMs(0), began)], 0)).data(None)
    assert data["chart"] == [{"depth": 2, "points": [[0.0, 0.0], [3.0, 4.0]]}]
    assert data["fence"] == [[-5, -5], [33, -5], [33, 26], [-5, 26]] and data["keep_out"] == []


@pytest.mark.parametrize(("name", "depths"), [("paper-pool", {None}), ("paper-bay", {None, 2, 4})])
def test_the_paper_s_areas_need_no_file(tmp_path, name, depths):
    """A copy of the scenario elsewhere has them too, and a run's own scenario.yaml names them alike."""
    scenario = load(scenario_with(tmp_path, name))
    assert scenario.area.chart == name
    assert {line.depth_m for line in chart_of(name, scenario.area.origin)} == depths
    write_resolved(tmp_path / "resolved.yaml", scenario)
    assert load(tmp_path / "resolved.yaml") == scenario
