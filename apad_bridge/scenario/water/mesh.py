"""Resamples a field on the nodes of triangles to a grid of lines: linear on each triangle, in plain numpy.

Agents know one form of a field, the grid of `agents.water.water_current`. Its lines are closest at the area's origin, where
a third of an edge lies between two. So the grid loses little there beside what the model's own mesh does not resolve.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import accumulate

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Indices = NDArray[np.intp]

GROWTHS = (0.0, 1 / 32, 1 / 16, 1 / 8, 1 / 4, 1 / 2)
"""Shares of the distance from the origin by which lines may lie apart, tried until there are few enough crossings."""
_TYPICAL = 20
"""So many triangles nearest to the origin say how long an edge is there."""
_FINEST_M = 0.1
_ROUNDING = 1e-9
"""A crossing on the edge of two triangles may lie outside both by so much of their size."""
_PAIRS_AT_ONCE = 1_000_000


class TooManyPoints(ValueError):
    """Even the widest lines have more crossings than are allowed."""


@dataclass(frozen=True, slots=True)
class Resampling:
    """The crossings of lines in local NED; each has three nodes (n x 3) and their weights (n x 3), row by row."""

    norths_m: Floats
    easts_m: Floats
    nodes: Indices
    weights: Floats

    def of_nodes(self, values: Floats) -> Floats:
        """Returns (..., rows, columns) for values (..., nodes)."""
        found: Floats = np.einsum("...ij,ij->...i", values[..., self.nodes], self.weights)
        return found.reshape(*values.shape[:-1], len(self.norths_m), len(self.easts_m))


def resampling(places_m: Floats, triangles: Indices, reach_m: float, most: int) -> Resampling | None:
    """Returns at most `most` crossings within `reach_m` of the origin, to north and to east; None if no triangle is there.

    `places_m` has (north, east) of each node (n x 2), NaN for one that is too far to matter; `triangles` the nodes of each
    (n x 3), either way round. A crossing in no triangle has the value of the nearest point of the mesh. Raises
    TooManyPoints.
    """
    corners = places_m[triangles]
    low, high = corners.min(axis=1), corners.max(axis=1)
    is_near = ((low <= reach_m) & (high >= -reach_m)).all(axis=1) & (_doubled_areas(corners) != 0)
    triangles, corners, low, high = triangles[is_near], corners[is_near], low[is_near], high[is_near]
    if not len(triangles):
        return None
    (south, west), (north, east) = (
        np.clip(it, -reach_m, reach_m) for it in (low.min(axis=0), high.max(axis=0))
    )
    nearest = np.argsort(np.abs(corners.mean(axis=1)).max(axis=1), kind="stable")[:_TYPICAL]
    step_m = max(_FINEST_M, np.median(np.sqrt(np.abs(_doubled_areas(corners[nearest])) / 2)) / 2)
    for growth in GROWTHS:
        norths, easts = _lines(south, north, step_m, growth, most), _lines(west, east, step_m, growth, most)
        if len(norths) * len(easts) <= most:
            break
    else:
        raise TooManyPoints(
            f"{len(norths) * len(easts)} points are needed near the area, at most {most} are taken"
        )
    return _on_lines(norths, easts, places_m, triangles)


def _doubled_areas(corners: Floats) -> Floats:
    """Returns twice the signed area of each triangle: NaN for one with a node that is too far."""
    one, other = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    areas: Floats = one[:, 0] * other[:, 1] - one[:, 1] * other[:, 0]
    return areas


def _lines(low: float, high: float, step_m: float, growth: float, most: int) -> Floats:
    """Returns rising places of lines from `low` to `high`, in whole millimetres; more than `most` are left out."""
    centre = min(max(0.0, low), high)

    def offsets(span: float) -> Iterator[float]:
        for offset in accumulate(range(most + 1), lambda at, _: at + max(step_m, growth * at), initial=0.0):
            yield min(offset, span)
            if offset >= span:
                return

    places = [centre - it for it in offsets(centre - low)] + [centre + it for it in offsets(high - centre)]
    rising: Floats = np.unique(np.round(places, 3))
    return rising


def _on_lines(norths: Floats, easts: Floats, places_m: Floats, triangles: Indices) -> Resampling:
    corners = places_m[triangles]
    low, high = corners.min(axis=1), corners.max(axis=1)
    # The lines sort the triangles: each is tried for the crossings in its box alone.
    margin = _ROUNDING * (high - low).max()
    firsts, counts = [], []
    for axis, lines in enumerate((norths, easts)):
        firsts.append(np.searchsorted(lines, low[:, axis] - margin, side="left"))
        counts.append(np.searchsorted(lines, high[:, axis] + margin, side="right") - firsts[-1])
    in_box = counts[0] * counts[1]
    of = np.repeat(np.arange(len(triangles)), in_box)
    number = np.arange(len(of)) - np.repeat(np.cumsum(in_box) - in_box, in_box)
    row, column = firsts[0][of] + number // counts[1][of], firsts[1][of] + number % counts[1][of]
    weights = _barycentric(corners[of], np.column_stack((norths[row], easts[column])))
    is_inside = (weights >= -_ROUNDING).all(axis=1)
    crossing = (row * len(easts) + column)[is_inside]
    nodes_of = np.zeros((len(norths) * len(easts), 3), dtype=np.intp)
    weights_of = np.full(nodes_of.shape, np.nan)
    nodes_of[crossing], weights_of[crossing] = triangles[of[is_inside]], weights[is_inside]
    outside = np.flatnonzero(np.isnan(weights_of[:, 0]))
    points = np.column_stack((norths[outside // len(easts)], easts[outside % len(easts)]))
    nodes_of[outside], weights_of[outside] = _nearest(points, places_m, _border(triangles))
    return Resampling(norths, easts, nodes_of, weights_of)


def _barycentric(corners: Floats, points: Floats) -> Floats:
    """Returns the weight of each corner (n x 3) at one point of each triangle."""
    areas = _doubled_areas(corners)
    parts = []
    for kept in ((1, 2), (2, 0)):
        part = np.stack([points, corners[:, kept[0]], corners[:, kept[1]]], axis=1)
        parts.append(_doubled_areas(part) / areas)
    return np.column_stack((*parts, 1 - parts[0] - parts[1]))


def _border(triangles: Indices) -> Indices:
    """Returns the edges (n x 2) that one triangle alone has: the coast, islands, and the open border."""
    edges = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    each, count = np.unique(edges, axis=0, return_counts=True)
    single: Indices = each[count == 1]
    return single


def _nearest(points: Floats, places_m: Floats, edges: Indices) -> tuple[Indices, Floats]:
    """Returns nodes and weights (n x 3 each) of the nearest place on an edge; the third weight is 0."""
    begin = places_m[edges[:, 0]]
    north, east = (places_m[edges[:, 1]] - begin).T
    squares = north**2 + east**2
    nodes = np.zeros((len(points), 3), dtype=np.intp)
    weights = np.zeros((len(points), 3))
    step = max(1, _PAIRS_AT_ONCE // len(edges))
    for first in range(0, len(points), step):
        some = slice(first, first + step)
        to_north, to_east = (points[some, axis, None] - begin[:, axis] for axis in (0, 1))
        along = to_north * north + to_east * east
        shares = np.clip(along / squares, 0, 1)
        best = (to_north**2 + to_east**2 - shares * (2 * along - shares * squares)).argmin(axis=1)
        share = shares[np.arange(len(best)), best]
        nodes[some, :2] = edges[best]
        weights[some, :2] = np.column_stack((1 - share, share))
    return nodes, weights
