"""Simple polygons in the local plane: area, self-crossing and containment.

Corners are (north, east) in metres, in order either way round, not closed. shapely computes; it is imported when
a function is called, so that a command that reads no scenario starts without it.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from agents.hosting.interrupts import held_back

Point = tuple[float, float]


def area_m2(corners: Sequence[Point]) -> float:
    """Enclosed area, never negative; for a simple polygon only."""
    return float(_plane(corners).area)


def is_simple(corners: Sequence[Point]) -> bool:
    """Returns True if edges meet only as neighbours in their common corner, without folding back."""
    return len(set(corners)) == len(corners) and bool(_plane(corners).is_valid)


def contains(corners: Sequence[Point], point: Point) -> bool:
    """Tests whether a point lies inside. Points on an edge lie outside."""
    return bool(_shapely().contains_xy(_plane(corners), *point))


def bounding_box(corners: Sequence[Point]) -> tuple[Point, Point]:
    """(lowest north, lowest east), (highest north, highest east)."""
    low_north, low_east, high_north, high_east = _plane(corners).bounds
    return (low_north, low_east), (high_north, high_east)


def inner_point(corners: Sequence[Point]) -> Point:
    """A point well inside, also of a polygon whose centroid lies outside."""
    point = _plane(corners).representative_point()
    return (float(point.x), float(point.y))


def _plane(corners: Sequence[Point]) -> Any:
    return _shapely().Polygon(corners)


def _shapely() -> Any:
    # It imports numpy from C, which would print an interrupt's traceback and make an ImportError of it.
    with held_back():
        import shapely
    return shapely
