"""Who serves whom, where there are several aPads: shares of equal number that lie close together.

Plain k-means makes clusters of up to twice the mean size, and the aMussels of an overloaded aPad starve. So this is
k-means under a capacity: each aMussel goes to a share such that the sum of squared distances to the shares' centres is the
least of all divisions into equal shares (an exact minimum-cost flow), the centres move to the middles of their shares, and
so on until the sum no longer falls. The first centres are the aPads' starts, so that each aPad's share begins where it is.

While a mission runs, when an aPad has failed, the same is asked again over those that are left: the first centres are then
the middles of what they serve, and who cannot be moved stays and counts.

All in whole millimetres: sums are exact, ties are broken by the order of aPads and ids, and the rounds must end.
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


def shares(
    starts_m: Sequence[Point], places_m: Mapping[int, Point], stays: Mapping[int, int] = MappingProxyType({})
) -> tuple[tuple[int, ...], ...]:
    """The ids that each aPad serves, rising, in the order of `starts_m`: their numbers differ by one at most.

    `stays` are those of `places_m` that an aPad keeps, by its place in `starts_m`; the numbers are then as equal as can be.
    ValueError without an aPad, or for a place farther than 100 km from the origin.
    """
    if not starts_m:
        raise ValueError("shares need an aPad")
    kept = sorted(stays)
    ids = [*kept, *sorted(places_m.keys() - stays.keys())]
    if not ids:
        return ((),) * len(starts_m)
    places = _millimetres([places_m[agent_id] for agent_id in ids])
    centres = _millimetres(starts_m)
    fixed = [stays[agent_id] for agent_id in kept]
    taken = [fixed.count(n) for n in range(len(starts_m))]

    def owned(centres: Millimetres) -> list[int]:
        return [*fixed, *assigned(_squares(places[len(fixed) :], centres), taken)]

    owners = owned(centres)
    total = inf
    while (now := _about_middles(places, owners, len(starts_m))) < total:
        total, chosen = now, owners
        owners = owned(_middles(places, owners, centres))
    return tuple(
        tuple(sorted(agent_id for agent_id, owner in zip(ids, chosen, strict=True) if owner == n))
        for n in range(len(starts_m))
    )


def assigned(costs: npt.NDArray[Any], taken: Sequence[int] = ()) -> list[int]:
    """The owner of each row, such that the owners' numbers are as equal as can be and the sum of costs is the least.

    `costs` are whole numbers, (rows, owners); `taken` says how many each owner has besides. Rows are given owners one by
    one, each along the cheapest chain of moves (it takes one's place, who takes another's, ...) to an owner who has room:
    successive shortest paths, which is exact.
    """
    rows, owners = costs.shape
    owner_of = np.full(rows, -1, dtype=np.int64)
    sizes = list(taken) or [0] * owners
    even, level = _evened(rows, sizes)
    for row in range(rows):
        # All get `even` first. Who gets one more is decided by the last rows, whose chains may move anybody.
        room = [size < even + (row >= level) for size in sizes]
        last, chain = _cheapest_chain(costs, owner_of, row, room)
        sizes[last] += 1
        for moved, owner in chain:
            owner_of[moved] = owner
    return [int(owner) for owner in owner_of]


def _evened(rows: int, sizes: Sequence[int]) -> tuple[int, int]:
    """The number up to which `rows` can fill every owner who has less, and how many rows that takes."""
    even = min(sizes)
    while sum(max(0, even + 1 - size) for size in sizes) <= rows:
        even += 1
    return even, sum(max(0, even - size) for size in sizes)


def _cheapest_chain(
    costs: npt.NDArray[Any], owner_of: npt.NDArray[Any], row: int, room: Sequence[bool]
) -> tuple[int, list[tuple[int, int]]]:
    """The owner whose number grows, and the moves (row, new owner): Bellman and Ford's shortest path over the owners."""
    owners = len(room)
    prices = np.full((owners, owners), _FAR, dtype=np.int64)
    movers = np.zeros((owners, owners), dtype=np.int64)
    for owner in range(owners):
        held = np.flatnonzero(owner_of == owner)
        if held.size:
            differences = costs[held] - costs[held, owner][:, None]
            cheapest = differences.argmin(axis=0)
            prices[owner] = differences[cheapest, np.arange(owners)]
            movers[owner] = held[cheapest]
    costs_to = [int(it) for it in costs[row]]
    came_from: list[int | None] = [None] * owners
    steps, is_settled = prices.tolist(), False
    while (
        not is_settled
    ):  # soon, for no round of moves gains anything: those who have owners stand at the least
        is_settled = True
        for source, target in product(range(owners), repeat=2):
            through = costs_to[source] + steps[source][target]
            if through < costs_to[target]:
                costs_to[target], came_from[target], is_settled = through, source, False
    last = min((owner for owner in range(owners) if room[owner]), key=lambda owner: costs_to[owner])
    chain, target = [], last
    while (before := came_from[target]) is not None:
        chain.append((int(movers[before, target]), target))
        target = before
    return last, [*chain, (row, target)]


def _millimetres(points_m: Sequence[Point]) -> Millimetres:
    points = np.asarray(points_m, dtype=float)
    if not (np.abs(points) <= 1e5).all():
        raise ValueError("a place lies farther than 100 km from the origin")
    millimetres: Millimetres = np.rint(points * 1000).astype(np.int64)
    return millimetres


def _squares(places: Millimetres, centres: Millimetres) -> npt.NDArray[np.int64]:
    """(aMussels, aPads), square millimetres."""
    apart = places[:, None, :] - centres[None, :, :]
    squares: npt.NDArray[np.int64] = (apart**2).sum(axis=2)
    return squares


def _middles(places: Millimetres, owners: Sequence[int], centres: Millimetres) -> Millimetres:
    """An aPad without a share stays where it is."""
    of = np.asarray(owners)
    middles = [
        places[of == n].mean(axis=0) if (of == n).any() else centre for n, centre in enumerate(centres)
    ]
    rounded: Millimetres = np.rint(np.asarray(middles)).astype(np.int64)
    return rounded


def _about_middles(places: Millimetres, owners: Sequence[int], count: int) -> int:
    """The sum of squared distances to the shares' own middles, square millimetres."""
    own = _middles(places, owners, np.zeros((count, 2), dtype=np.int64))[np.asarray(owners)]
    # By Python's whole numbers: a large fleet in a large area is more than 64 bits hold.
    return sum(((places - own) ** 2).sum(axis=1).tolist())
