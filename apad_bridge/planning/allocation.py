"""Divides the fleet among several aPads into compact shares of equal size.

Plain k-means makes clusters of up to twice the mean size, and the aMussels of an overloaded aPad starve. So this is
k-means under a capacity. It assigns the aMussels to shares such that the sum of squared distances to the shares' centres
is the least of all divisions into equal shares (an exact minimum-cost flow). Then it moves the centres to the centroids of
their shares, and repeats both until the sum no longer falls. The first centres are the aPads' starts, so that each share
begins at its aPad.

When an aPad fails during a mission, the same algorithm runs over the remaining aPads. The first centres are then the
centroids of the aMussels that they serve. aMussels that cannot be moved stay with their aPad and count.

All numbers are whole millimetres: sums are exact, the order of aPads and ids breaks ties, and the iteration must end.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import product
from math import inf
from types import MappingProxyType
from typing import Any

import numpy as np
import numpy.typing as npt

Point = tuple[float, float]
"""(north, east), metres."""
Millimetres = npt.NDArray[np.int64]
_FAR = np.iinfo(np.int64).max // 4


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
    ids = [*fixed_ids, *sorted(places_m.keys() - fixed_owner_of.keys())]
    if not ids:
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

    `costs` are whole numbers, (rows, owners); `fixed_counts` are the rows that each owner has besides. Rows get owners one
    by one, each along the cheapest chain of moves (a row displaces another row, which displaces a third, ...) to an owner
    with room: successive shortest paths, which is exact.
    """
    rows, owners = costs.shape
    owner_of = np.full(rows, -1, dtype=np.int64)
    sizes = list(fixed_counts) or [0] * owners
    even, rows_to_even = _even_size(rows, sizes)
    for row in range(rows):
        # All get `even` first. The last rows decide which owners get one more: their chains may move any row.
        has_room = [size < even + (row >= rows_to_even) for size in sizes]
        last, chain = _cheapest_chain(costs, owner_of, row, has_room)
        sizes[last] += 1
        for moved, owner in chain:
            owner_of[moved] = owner
    return [int(owner) for owner in owner_of]


def _even_size(rows: int, sizes: Sequence[int]) -> tuple[int, int]:
    """Returns the size up to which `rows` can fill every smaller owner, and the number of rows that this takes."""
    even = min(sizes)
    while sum(max(0, even + 1 - size) for size in sizes) <= rows:
        even += 1
    return even, sum(max(0, even - size) for size in sizes)


def _cheapest_chain(
    costs: npt.NDArray[Any], owner_of: npt.NDArray[Any], row: int, has_room: Sequence[bool]
) -> tuple[int, list[tuple[int, int]]]:
    """Returns the owner that grows, and the moves (row, new owner), by Bellman and Ford's shortest path over the owners."""
    owners = len(has_room)
    prices = np.full((owners, owners), _FAR, dtype=np.int64)
    movers = np.zeros((owners, owners), dtype=np.int64)
    for owner in range(owners):
        owned_rows = np.flatnonzero(owner_of == owner)
        if owned_rows.size:
            differences = costs[owned_rows] - costs[owned_rows, owner][:, None]
            cheapest = differences.argmin(axis=0)
            prices[owner] = differences[cheapest, np.arange(owners)]
            movers[owner] = owned_rows[cheapest]
    costs_to = [int(it) for it in costs[row]]
    predecessors: list[int | None] = [None] * owners
    steps, is_settled = prices.tolist(), False
    # The loop ends soon: the assigned rows have the least cost, so no cycle of moves gains anything.
    while not is_settled:
        is_settled = True
        for source, target in product(range(owners), repeat=2):
            through = costs_to[source] + steps[source][target]
            if through < costs_to[target]:
                costs_to[target], predecessors[target], is_settled = through, source, False
    last = min((owner for owner in range(owners) if has_room[owner]), key=lambda owner: costs_to[owner])
    chain, target = [], last
    while (previous := predecessors[target]) is not None:
        chain.append((int(movers[previous, target]), target))
        target = previous
    return last, [*chain, (row, target)]


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
