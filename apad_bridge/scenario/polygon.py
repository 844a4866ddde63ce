"""Simple polygons in the local plane: area, self-crossing and containment.

Corners are (north, east) in metres, in order either way round, not closed.
"""

from __future__ import annotations

from collections.abc import Sequence

Point = tuple[float, float]


def area_m2(corners: Sequence[Point]) -> float:
    """Enclosed area by the shoelace formula, never negative; for a simple polygon only."""
    return abs(sum(_cross((0.0, 0.0), a, b) for a, b in _edges(corners))) / 2


def is_simple(corners: Sequence[Point]) -> bool:
    """Returns True if edges meet only as neighbours in their common corner, without folding back."""
    edges = _edges(corners)
    last = len(edges) - 1
    for i, first in enumerate(edges):
        if first[0] == first[1]:
            return False
        for j in range(i + 1, len(edges)):
            if j == i + 1 or (i == 0 and j == last):
                if _folds_back(first, edges[j]):
                    return False
            elif _meet(first, edges[j]):
                return False
    return True


def contains(corners: Sequence[Point], point: Point) -> bool:
    """Tests a point by the parity of the edges to its east. Points on an edge may go either way."""
    inside = False
    for (north_a, east_a), (north_b, east_b) in _edges(corners):
        if (north_a > point[0]) != (north_b > point[0]):
            fraction = (point[0] - north_a) / (north_b - north_a)
            inside ^= point[1] < east_a + fraction * (east_b - east_a)
    return inside


def bounding_box(corners: Sequence[Point]) -> tuple[Point, Point]:
    """(lowest north, lowest east), (highest north, highest east)."""
    norths, easts = [corner[0] for corner in corners], [corner[1] for corner in corners]
    return (min(norths), min(easts)), (max(norths), max(easts))


def _edges(corners: Sequence[Point]) -> list[tuple[Point, Point]]:
    return list(zip(corners, [*corners[1:], corners[0]], strict=True))


def _cross(o: Point, a: Point, b: Point) -> float:
    return (a[0] - o[0]) * (b[1] - o[1]) - (a[1] - o[1]) * (b[0] - o[0])


def _folds_back(first: tuple[Point, Point], second: tuple[Point, Point]) -> bool:
    """Returns True if two edges that share a corner lie on one line, on the same side of that corner."""
    corner = first[1] if first[1] in second else first[0]
    a = first[0] if corner == first[1] else first[1]
    b = second[1] if corner == second[0] else second[0]
    ahead = (a[0] - corner[0]) * (b[0] - corner[0]) + (a[1] - corner[1]) * (b[1] - corner[1])
    return _cross(corner, a, b) == 0 and ahead > 0


def _meet(first: tuple[Point, Point], second: tuple[Point, Point]) -> bool:
    (a, b), (c, d) = first, second
    sides = _cross(a, b, c), _cross(a, b, d), _cross(c, d, a), _cross(c, d, b)
    if sides[0] * sides[1] < 0 and sides[2] * sides[3] < 0:
        return True
    touching = ((a, b, c), (a, b, d), (c, d, a), (c, d, b))
    return any(side == 0 and _within_box(*points) for side, points in zip(sides, touching, strict=True))


def _within_box(a: Point, b: Point, point: Point) -> bool:
    return all(min(a[k], b[k]) <= point[k] <= max(a[k], b[k]) for k in (0, 1))
