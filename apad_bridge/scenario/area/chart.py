"""The chart of a scenario's area, for maps alone: shorelines and depth contours from a GeoJSON file.

The file holds [longitude, latitude] in degrees: LineStrings and Polygons, alone or Multi, in Features. A Feature with the
property `depth_m` is the contour of that depth; all else is shore.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

from apad_bridge.scenario.area.local_frame import LocalFrame, OriginLike
from apad_bridge.scenario.area.paper_charts import PAPER_CHARTS
from apad_bridge.scenario.area.polygon import Point
from apad_bridge.scenario.text.text_file import read_text
from firmware_model.entry_points import in_one_line

_NESTING = {"LineString": 0, "MultiLineString": 1, "Polygon": 1, "MultiPolygon": 2}
"""Depth of the lists of positions in a geometry's coordinates."""


class ChartLine(NamedTuple):
    depth_m: float | None
    """None for a shoreline."""
    points: tuple[Point, ...]
    """(north, east) in local metres, two or more."""


def chart_of(name: str, origin: OriginLike) -> tuple[ChartLine, ...]:
    """The lines of a chart: one of the paper's areas by its name, or a file.

    OSError, or ValueError for a file that is no such GeoJSON.
    """
    if name in PAPER_CHARTS:
        return tuple(ChartLine(*it) for it in PAPER_CHARTS[name])
    frame = LocalFrame.about(origin)
    try:
        return tuple(
            ChartLine(depth_m, tuple(frame.to_local(float(it[1]), float(it[0])) for it in positions))
            for depth_m, positions in _lines_of(json.loads(read_text(Path(name))), None)
        )
    except (KeyError, TypeError, IndexError, AttributeError, RecursionError) as error:
        raise ValueError(f"is no GeoJSON of lines: {in_one_line(error)}") from error


def _lines_of(data: dict[str, Any], depth_m: float | None) -> Iterator[tuple[float | None, list[Any]]]:
    kind = data["type"]
    if kind == "FeatureCollection":
        for feature in data["features"]:
            yield from _lines_of(feature, None)
        return
    if kind == "Feature":
        depth = (data.get("properties") or {}).get("depth_m")
        if depth is not None and not (type(depth) in (int, float) and math.isfinite(depth)):
            raise ValueError(f"depth_m must be a number of metres, not {depth!r}")
        yield from _lines_of(data["geometry"], depth)
        return
    if kind not in _NESTING:
        raise ValueError(f"must hold lines or polygons, and holds a {kind}")
    lines = [data["coordinates"]]
    for _ in range(_NESTING[kind]):
        lines = [inner for outer in lines for inner in outer]
    for line in lines:
        if len(line) < 2:
            raise ValueError("a line needs two positions or more")
        yield depth_m, line
