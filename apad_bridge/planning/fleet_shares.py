"""Divides the fleet among several aPads into compact shares of equal size.

Plain k-means makes clusters of up to twice the mean size, and the aMussels of an overloaded aPad starve. So this is
k-means under a capacity. It assigns the aMussels to shares such that the sum of squared distances to the shares' centres
is the least of all divisions into equal shares (an assignment problem, solved exactly). Then it moves the centres to the
centroids of their shares, and repeats both until the sum no longer falls. The first centres are the aPads' starts, so that
each share begins at its aPad.

When an aPad fails during a mission, the same algorithm runs over the remaining aPads. The first centres are then the
centroids of the aMussels that they serve. aMussels that cannot be moved stay with their aPad and count.

All numbers are whole millimetres: sums are exact, the same input gives the same shares, and the iteration must end.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import inf
from types import MappingProxyType
from typing import Any

import numpy as np
import numpy.typing as npt

Point = tuple[float, float]
"""(north, east), metres."""
Millimetres = npt.NDArray[np.int64]


def allocate(
    starts_m: Sequence[Point],
    places_m: Mapping[int, Point],
    fixed_owner_of: Mapping[int, int] = MappingProxyType({}),
) -> tuple[tuple[int, ...], ...]:
    """Returns the ids that each aPad serves, ascending, in the order of `starts_m`; sizes differ by one at most.

    `fixed_owner_of` names the ids of `places_m` that an aPad keeps, with the aPad's index in `starts_m`; sizes are then as
    equal as possible. Raises ValueError without an aPad, or for a place farther than 100 km from the origin.
    """
    if not starts_m:
        raise ValueError("shares need an aPad")
    fixed_ids = sorted(fixed_owner_of)
    if not (ids := [*fixed_ids, *sorted(places_m.keys() - fixed_owner_of.keys())]):
        return ((),) * len(starts_m)
    places = _millimetres([places_m[agent_id] for agent_id in ids])
    centres = _millimetres(starts_m)
    fixed_owners = [fixed_owner_of[agent_id] for agent_id in fixed_ids]
    fixed_counts = [fixed_owners.count(n) for n in range(len(starts_m))]

    def owners_about(centres: Millimetres) -> list[int]:
        return [
            *fixed_owners,
            *min_cost_assignment(_squares(places[len(fixed_owners) :], centres), fixed_counts),
        ]

    owners = owners_about(centres)
    least = inf
    while (total := _sum_of_squares(places, owners, len(starts_m))) < least:
        least, best = total, owners
        owners = owners_about(_centroids(places, owners, centres))
    return tuple(
        tuple(sorted(agent_id for agent_id, owner in zip(ids, best, strict=True) if owner == n))
        for n in range(len(starts_m))
    )


def min_cost_assignment(costs: npt.NDArray[Any], fixed_counts: Sequence[int] = ()) -> list[int]:
    """Assigns each row to an owner, such that the owners' sizes are as equal as possible and the sum of costs is the least.

    `costs` are whole numbers, (rows, owners); `fixed_counts` are the rows that each owner has besides. In the assignment
    problem an owner is a column for each row that it must get, and one more where it may get one more; rows without a
    cost fill what is left of the latter.
    """
    # Imported here because it takes 0.4 s, and only several aPads divide a fleet.
    from scipy.optimize import linear_sum_assignment

    rows, owners = costs.shape
    sizes = np.array(fixed_counts or [0] * owners)
    even, must_get = _even_size(rows, sizes.tolist())
    owner_of = np.concatenate(
        (np.repeat(np.arange(owners), np.maximum(0, even - sizes)), np.flatnonzero(sizes <= even))
    )
    # The least of a row changes no choice; without it the costs are smaller, and exact as floats up to 2^53.
    needed = (costs - costs.min(axis=1, keepdims=True))[:, owner_of].astype(float)
    fillers = np.zeros((len(owner_of) - rows, len(owner_of)))
    fillers[:, :must_get] = np.inf
    _, columns = linear_sum_assignment(np.vstack((needed, fillers)))
    chosen: list[int] = owner_of[columns[:rows]].tolist()
    return chosen


def _even_size(rows: int, sizes: Sequence[int]) -> tuple[int, int]:
    """Returns the size up to which `rows` can fill every smaller owner, and the number of rows that this takes."""
    even = min(sizes)
    while sum(max(0, even + 1 - size) for size in sizes) <= rows:
        even += 1
    return even, sum(max(0, even - size) for size in sizes)


def _millimetres(points_m: Sequence[Point]) -> Millimetres:
    points = np.asarray(points_m, dtype=float)
    if not (np.abs(points) <= 1e5).all():
        raise ValueError("a place lies farther than 100 km from the origin")
    millimetres: Millimetres = np.rint(points * 1000).astype(np.int64)
    return millimetres


def _squares(places: Millimetres, centres: Millimetres) -> npt.NDArray[np.int64]:
    """Returns squared distances in square millimetres, shape (aMussels, aPads)."""
    offsets = places[:, None, :] - centres[None, :, :]
    squares: npt.NDArray[np.int64] = (offsets**2).sum(axis=2)
    return squares


def _centroids(places: Millimetres, owners: Sequence[int], centres: Millimetres) -> Millimetres:
    """Returns the shares' centroids; an aPad without a share keeps its centre."""
    owner_of = np.asarray(owners)
    centroids = [
        places[owner_of == n].mean(axis=0) if (owner_of == n).any() else centre
        for n, centre in enumerate(centres)
    ]
    rounded: Millimetres = np.rint(np.asarray(centroids)).astype(np.int64)
    return rounded


def _sum_of_squares(places: Millimetres, owners: Sequence[int], count: int) -> int:
    """Sums the squared distances to the shares' own centroids, in square millimetres."""
    own = _centroids(places, owners, np.zeros((count, 2), dtype=np.int64))[np.asarray(owners)]
    # Python's integers, because the sum of a large fleet in a large area exceeds 64 bits.
    return sum(((places - own) ** 2).sum(axis=1).tolist())
