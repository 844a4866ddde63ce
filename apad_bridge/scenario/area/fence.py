"""The fence of a scenario: a keep-in polygon and keep-out zones, as corners in local NED metres or in GeoJSON files.

A GeoJSON file holds [longitude, latitude] in degrees: one Polygon for the fence, whose holes are keep-out zones, and any
number of Polygons or MultiPolygons for keep-out zones; alone, in a Feature, or in a FeatureCollection.
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
from apad_bridge.scenario.text_file import read_text

Corners = tuple[Point, ...]


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
    polygons = _polygons_of(Path(fence), frame)
    if len(polygons) != 1:
        raise ValueError(f"must hold one polygon, and holds {len(polygons)}")
    return Fence(polygons[0][0], (*polygons[0][1:], *zones))


def _zones_of(path: Path, frame: LocalFrame) -> tuple[Corners, ...]:
    return tuple(rings[0] for rings in _polygons_of(path, frame))


def _polygons_of(path: Path, frame: LocalFrame) -> list[tuple[Corners, ...]]:
    """The rings of each polygon in a GeoJSON file, the outer one first."""
    try:
        found = _rings_of(json.loads(read_text(path)))
        polygons = [
            tuple(tuple(frame.to_local(float(it[1]), float(it[0])) for it in ring[:-1]) for ring in rings)
            for rings in found
        ]
    except (KeyError, TypeError, IndexError, AttributeError, RecursionError) as error:
        raise ValueError(f"is no GeoJSON of polygons: {type(error).__name__} {error}") from error
    for rings in polygons:
        for ring in rings:
            check_corners(ring, "a ring of a polygon")
    return polygons


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
