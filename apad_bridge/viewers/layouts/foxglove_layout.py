"""The layout for Foxglove: the scene from above, /diagnostics, and tabs of plots for each aPad and for a run's bag."""

from __future__ import annotations

import json
from collections.abc import Iterable
from typing import Any

from apad_bridge.ros_names.names import DIAGNOSTICS, plain
from apad_bridge.viewers.layouts.layout_content import LayoutAPad, LayoutFleet, grid_of, hexadecimal, in_bag

_MAX_LEGEND = 24
"""A legend with more lines than this would hide its plot."""
_MARGIN = 1.4
_WIDER = 1.2
"""The width of the scene's panel over its height on a common screen."""
_THIN = 500
"""The area's span over a line's width: the line is about a pixel and a half wide."""
Panels = dict[str, Any]


def layout(fleet: LayoutFleet) -> str:
    panels: Panels = {"3D!scene": _scene(fleet)}
    tabs = [
        *({"title": apad.name, "layout": _plots_of(panels, fleet, apad)} for apad in fleet.apads),
        {"title": "run.bag", "layout": _plots_of_bag(panels, fleet)},
    ]
    panels["Tab!plots"] = {"activeTabIdx": 0, "tabs": tabs}
    panels["DiagnosticSummary!fleet"] = {
        "topicToRender": DIAGNOSTICS,
        "minLevel": 0,
        "pinnedIds": [],
        "hardwareIdFilter": "",
        "sortByLevel": True,
    }
    data = {
        "configById": panels,
        "globalVariables": {},
        "userNodes": {},
        "playbackConfig": {"speed": 1},
        "layout": _row("3D!scene", _column("Tab!plots", "DiagnosticSummary!fleet", 60), 60),
    }
    return json.dumps(data, indent=2) + "\n"


def _scene(fleet: LayoutFleet) -> dict[str, Any]:
    topics: dict[str, Any] = {}
    thin_m = round(max(fleet.span_m) / _THIN, 3)
    for number, apad in enumerate(fleet.apads):
        own_colour = [hexadecimal(number) + "ff"] * 2 if len(fleet.apads) > 1 else None
        topics[apad.topic("markers")] = {"visible": True}
        topics[apad.topic("plan")] = _line(2 * thin_m, own_colour or ["#ffc800ff"] * 2)
        topics[apad.topic("apad/path")] = _line(thin_m, own_colour or ["#b4b4b4ff"] * 2)
    north_m, east_m = fleet.centre_m
    tall_m, wide_m = fleet.span_m
    return {
        "followTf": fleet.frames.enu,
        "followMode": "follow-none",
        "topics": topics,
        # Frames are at the same places as the markers, and their axes, names and lines would only hide the markers.
        "transforms": {f"frame:{frame}": {"visible": False} for frame in _frames(fleet)},
        "scene": {"backgroundColor": "#14283c"},
        "layers": {"grid": _grid(fleet)},
        "cameraState": {
            "perspective": False,
            "distance": round(_MARGIN * max(tall_m, wide_m / _WIDER), 1),
            "phi": 0,
            "thetaOffset": 0,
            "targetOffset": [east_m, north_m, 0],
            "target": [0, 0, 0],
            "targetOrientation": [0, 0, 0, 1],
        },
    }


def _frames(fleet: LayoutFleet) -> list[str]:
    frames = fleet.frames
    bodies = [*map(frames.agent, fleet.ids), *(frames.apad(apad.name) for apad in fleet.apads)]
    return [frames.enu, frames.ned, *bodies]


def _grid(fleet: LayoutFleet) -> dict[str, Any]:
    grid = grid_of(fleet)
    return {
        "layerId": "foxglove.Grid",
        "instanceId": "grid",
        "label": f"Grid ({grid.cell_m} m)",
        "visible": True,
        "frameLocked": True,
        "frameId": fleet.frames.enu,
        "size": grid.cell_m * grid.cells,
        "divisions": grid.cells,
        "lineWidth": 1,
        "color": "#46647880",
        "position": [grid.east_m, grid.north_m, 0],
        "rotation": [0, 0, 0],
    }


def _line(width_m: float, gradient: list[str]) -> dict[str, Any]:
    return {"visible": True, "type": "line", "lineWidth": width_m, "gradient": gradient}


def _plots_of(panels: Panels, fleet: LayoutFleet, apad: LayoutAPad) -> dict[str, Any]:
    charges, battery = (f"Plot!{plain(apad.name)}-{plot}" for plot in ("amussels", "battery"))
    panels[charges] = _plot(
        f"Batteries of {apad.name}'s aMussels" if len(fleet.apads) > 1 else "Batteries of the aMussels",
        ((str(agent_id), f"{topic}.percentage") for agent_id, topic in fleet.batteries(apad).items()),
    )
    panels[battery] = _plot(
        f"Battery of {apad.name}", [(apad.name, f"{apad.topic('apad/battery_state')}.percentage")]
    )
    return _column(charges, battery, 70)


def _plots_of_bag(panels: Panels, fleet: LayoutFleet) -> dict[str, Any]:
    """Plots of a run's bag, whose names do not depend on the graph. With several aPads each one has a bag of its own."""
    for panel, title, topic, field in (
        ("Plot!bag-truth", "Charges as they are", in_bag("truth"), "primary"),
        ("Plot!bag-beliefs", "Charges as believed", in_bag("beliefs"), "charge"),
    ):
        panels[panel] = _plot(
            title, ((str(it), f"{topic}.agents[:]{{id=={it}}}.{field}") for it in fleet.ids)
        )
    return _column("Plot!bag-truth", "Plot!bag-beliefs", 50)


def _plot(title: str, paths: Iterable[tuple[str, str]]) -> dict[str, Any]:
    """A plot of fractions; each path comes with its label."""
    curves = [
        {
            "value": path,
            "label": label,
            "color": hexadecimal(number),
            "enabled": True,
            "timestampMethod": "receiveTime",
        }
        for number, (label, path) in enumerate(paths)
    ]
    return {
        "foxglovePanelTitle": title,
        "paths": curves,
        "minYValue": 0,
        "maxYValue": 1,
        "showLegend": len(curves) <= _MAX_LEGEND,
        "legendDisplay": "left",
        "showPlotValuesInLegend": False,
        "showXAxisLabels": True,
        "showYAxisLabels": True,
        "isSynced": True,
        "xAxisVal": "timestamp",
        "sidebarDimension": 90,
    }


def _row(first: Any, second: Any, percent: int) -> dict[str, Any]:
    return {"direction": "row", "first": first, "second": second, "splitPercentage": percent}


def _column(first: Any, second: Any, percent: int) -> dict[str, Any]:
    return {"direction": "column", "first": first, "second": second, "splitPercentage": percent}
