"""The layout for RViz: displays for each aPad's markers, plan and track, seen from above, north up."""

from __future__ import annotations

from typing import Any

import yaml

from apad_bridge.viewers.layouts.layout_content import LayoutAPad, LayoutFleet, colour, grid_of

_WIDTH_PX, _HEIGHT_PX = 1360, 860
_WATER_WIDTH_PX, _WATER_HEIGHT_PX = 1320, 760
"""The part of the window that menus, tools and the status line leave free."""
_MARGIN = 0.9


def layout(fleet: LayoutFleet) -> str:
    displays = [_grid(fleet)]
    for number, apad in enumerate(fleet.apads):
        displays += _displays(apad, number, alone=len(fleet.apads) == 1)
    displays.append({"Class": "rviz/TF", "Name": "Frames", "Enabled": False, "Value": False})
    data = {
        "Panels": [],  # the menu Panels opens the list of displays and the time
        "Visualization Manager": {
            "Class": "",
            "Enabled": True,
            "Global Options": {
                "Background Color": "20; 40; 60",
                "Fixed Frame": fleet.frames.enu,
                "Frame Rate": 30,
            },
            "Displays": displays,
            "Tools": [{"Class": "rviz/MoveCamera"}, {"Class": "rviz/Measure"}],
            "Views": {"Current": _from_above(fleet)},
        },
        "Window Geometry": {"Width": _WIDTH_PX, "Height": _HEIGHT_PX, "X": 0, "Y": 0},
    }
    text: str = yaml.safe_dump(data, sort_keys=False)
    return text


def _displays(apad: LayoutAPad, number: int, *, alone: bool) -> list[dict[str, Any]]:
    of = "" if alone else f" of {apad.name}"
    plan, way = ((255, 200, 0), (180, 180, 180)) if alone else (colour(number),) * 2
    return [
        {
            "Class": "rviz/MarkerArray",
            "Name": "aMussels and aPad" if alone else f"{apad.name} and its aMussels",
            "Enabled": True,
            "Marker Topic": apad.topic("markers"),
            "Value": True,
        },
        _path(f"Plan{of}", apad.topic("plan"), plan, alpha=1.0),
        _path(f"Way of {apad.name}", apad.topic("apad/path"), way, alpha=0.5),
    ]


def _path(name: str, topic: str, rgb: tuple[int, int, int], alpha: float) -> dict[str, Any]:
    return {
        "Class": "rviz/Path",
        "Name": name,
        "Enabled": True,
        "Topic": topic,
        "Color": "; ".join(map(str, rgb)),
        "Alpha": alpha,
        "Line Style": "Lines",
        "Value": True,
    }


def _grid(fleet: LayoutFleet) -> dict[str, Any]:
    grid = grid_of(fleet)
    return {
        "Class": "rviz/Grid",
        "Name": f"Grid ({grid.cell_m} m)",
        "Enabled": True,
        "Cell Size": grid.cell_m,
        "Plane Cell Count": grid.cells,
        "Offset": {"X": grid.east_m, "Y": grid.north_m, "Z": 0},
        "Color": "70; 100; 120",
        "Value": True,
    }


def _from_above(fleet: LayoutFleet) -> dict[str, Any]:
    (north_m, east_m), (tall_m, wide_m) = fleet.centre_m, fleet.span_m
    return {
        "Class": "rviz/TopDownOrtho",
        "Name": "From above",
        # pixels per metre
        "Scale": round(_MARGIN * min(_WATER_WIDTH_PX / wide_m, _WATER_HEIGHT_PX / tall_m), 1),
        "X": east_m,
        "Y": north_m,
        "Value": "TopDownOrtho (rviz)",
    }
