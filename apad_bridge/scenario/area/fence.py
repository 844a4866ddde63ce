"""The polygons of a scenario: its area, and its fence with keep-out zones, as corners or in GeoJSON files.

A GeoJSON file holds [longitude, latitude] in degrees: one Polygon for the area or the fence, whose holes are keep-out
zones, and any number of Polygons or MultiPolygons for keep-out zones; alone, in a Feature, or in a FeatureCollection.
"""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

from apad_bridge.scenario.area.local_frame import LocalFrame, OriginLike
from apad_bridge.scenario.area.polygon import Point, area_m2, is_simple
from apad_bridge.scenario.text.text_file import read_text
from firmware_model.entry_points import in_one_line

Corners = tuple[Point, ...]
LEAST_SIDE_M = 1.0
"""The least extent of an area or a fence, north and east: a smaller one has degrees in place of metres."""
_FAR_M = 100_000.0


@dataclass(frozen=True, slots=True)
class Fence:
    corners: Corners
    keep_out: tuple[Corners, ...]

    def waters(self) -> Any:
        """The fence less its keep-out zones, as a geometry of shapely."""
        import shapely

        zones = shapely.union_all([shapely.Polygon(zone) for zone in self.keep_out])
        return shapely.Polygon(self.corners).difference(zones)

    @property
    def longest_m(self) -> float:
        """The distance of its two corners that are farthest apart: no straight way inside is longer."""
        return max(math.dist(a, b) for a in self.corners for b in self.corners)


def check_corners(corners: Sequence[Point], key: str) -> None:
    """Raises ValueError for corners that are no simple polygon; the message begins with `key`."""
    if len(corners) < 3:
        raise ValueError(f"{key} needs three corners or more")
    if not all(math.isfinite(it) for corner in corners for it in corner):
        raise ValueError(f"{key} must have finite corners")
    if not is_simple(corners):
        raise ValueError(f"{key} crosses or touches itself")
    if area_m2(corners) < 1e-6:
        raise ValueError(f"{key} encloses no area")


def check_size(corners: Sequence[Point], key: str, mend: str) -> None:
    """Raises ValueError for corners that are no simple polygon, or one of less than `LEAST_SIDE_M` north or east."""
    check_corners(corners, key)
    north_m, east_m = (max(values) - min(values) for values in zip(*corners, strict=True))
    if min(north_m, east_m) < LEAST_SIDE_M:
        raise ValueError(
            f"{key} is {north_m:.2g} by {east_m:.2g} m, and needs {LEAST_SIDE_M:g} m north and east: "
            f"these look like degrees; {mend}"
        )


class AreaLike(Protocol):
    """The scenario's `area`, which states its fence in corners or in files."""

    @property
    def origin(self) -> OriginLike: ...

    @property
    def fence(self) -> Corners | str | None: ...

    @property
    def keep_out(self) -> tuple[Corners, ...] | str: ...


def fence_of(area: AreaLike) -> Fence | None:
    """The area's fence; None for a scenario without one. OSError, or ValueError for a file that is no such GeoJSON."""
    frame, fence, keep_out = LocalFrame.about(area.origin), area.fence, area.keep_out
    zones = _zones_of(Path(keep_out), frame) if isinstance(keep_out, str) else keep_out
    if fence is None:
        return None
    if not isinstance(fence, str):
        return Fence(fence, zones)
    outer, *holes = _rings_in(Path(fence), frame)
    return Fence(outer, (*holes, *zones))


def corners_of(polygon: str | Sequence[Sequence[float]], frame: LocalFrame) -> Corners:
    """The corners of `area.polygon`: a GeoJSON file, or a list of [latitude, longitude] in degrees, closed or not.

    OSError, or ValueError for a polygon with holes, far from the origin, or none at all.
    """
    if isinstance(polygon, str):
        corners, *holes = _rings_in(Path(polygon), frame)
        if holes:
            raise ValueError(
                "has holes, and an area has none: name the file in area.fence, too, and remove them here"
            )
    else:
        closed = len(polygon) > 1 and polygon[0] == polygon[-1]
        corners = tuple(frame.to_local(*_pair(it)) for it in polygon[: -1 if closed else None])
    if (far_m := max((math.hypot(*it) for it in corners), default=0.0)) > _FAR_M:
        raise ValueError(
            f"lies {far_m / 1000:.0f} km from area.origin: correct the origin, or the order of the degrees; a list has "
            "[latitude, longitude], a GeoJSON file [longitude, latitude]"
        )
    return corners


def _pair(corner: Any) -> tuple[float, float]:
    try:
        latitude_deg, longitude_deg = corner
        return float(latitude_deg), float(longitude_deg)
    except (TypeError, ValueError):
        raise ValueError(f"a corner is [latitude, longitude] in degrees, not {corner!r}") from None


def rings_deg(path: Path) -> list[list[tuple[float, float]]]:
    """The rings of a GeoJSON file of one polygon, as (latitude, longitude), the outer one first. OSError, ValueError."""
    polygons = _polygons_deg(path)
    if len(polygons) != 1:
        raise ValueError(f"must hold one polygon, and holds {len(polygons)}")
    return polygons[0]


def _rings_in(path: Path, frame: LocalFrame) -> tuple[Corners, ...]:
    return _local(rings_deg(path), frame)


def _zones_of(path: Path, frame: LocalFrame) -> tuple[Corners, ...]:
    return tuple(_local(rings, frame)[0] for rings in _polygons_deg(path))


def _local(rings: Sequence[Sequence[tuple[float, float]]], frame: LocalFrame) -> tuple[Corners, ...]:
    found = tuple(tuple(frame.to_local(*it) for it in ring) for ring in rings)
    for ring in found:
        check_corners(ring, "a ring of a polygon")
    return found


def _polygons_deg(path: Path) -> list[list[list[tuple[float, float]]]]:
    """The rings of each polygon in a GeoJSON file, as (latitude, longitude), not closed, the outer one first."""
    try:
        found = _rings_of(json.loads(read_text(path)))
        return [[[(float(it[1]), float(it[0])) for it in ring[:-1]] for ring in rings] for rings in found]
    except (KeyError, TypeError, IndexError, AttributeError, RecursionError) as error:
        raise ValueError(f"is no GeoJSON of polygons: {in_one_line(error)}") from error


def _rings_of(data: dict[str, Any]) -> list[Any]:
    match data["type"]:
        case "Polygon":
            return [data["coordinates"]]
        case "MultiPolygon":
            return list(data["coordinates"])
        case "Feature":
            return _rings_of(data["geometry"])
        case "FeatureCollection":
            return [rings for feature in data["features"] for rings in _rings_of(feature)]
        case other:
            raise ValueError(f"must hold polygons, and holds a {other}")
