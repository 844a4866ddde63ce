"""Shares of the fleet: against all possible divisions, by laws, and on simple layouts."""

from __future__ import annotations

from itertools import product
from math import dist

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from apad_bridge.planning.fleet_shares import allocate, min_cost_assignment

METRES = st.integers(-40, 40).map(float)
POINTS = st.tuples(METRES, METRES)
COSTS = st.integers(1, 3).flatmap(
    lambda owners: st.lists(
        st.lists(st.integers(0, 50), min_size=owners, max_size=owners), min_size=1, max_size=7
    )
)


def least_by_trying_all(costs: list[list[int]]) -> int:
    owners, sums = len(costs[0]), []
    for owner_of in product(range(owners), repeat=len(costs)):
        sizes = [owner_of.count(owner) for owner in range(owners)]
        if max(sizes) - min(sizes) <= 1:
            sums.append(sum(row[owner] for row, owner in zip(costs, owner_of, strict=True)))
    return min(sums)


@given(COSTS)
def test_no_even_division_costs_less(costs: list[list[int]]) -> None:
    owner_of = min_cost_assignment(np.array(costs, dtype=np.int64))
    sizes = [owner_of.count(owner) for owner in range(len(costs[0]))]
    assert max(sizes) - min(sizes) <= 1
    assert sum(row[owner] for row, owner in zip(costs, owner_of, strict=True)) == least_by_trying_all(costs)


@given(st.lists(POINTS, min_size=1, max_size=5), st.dictionaries(st.integers(1, 99), POINTS, max_size=24))
def test_each_is_served_once_and_by_equal_shares(
    starts_m: list[tuple[float, float]], places_m: dict[int, tuple[float, float]]
) -> None:
    found = allocate(starts_m, places_m)
    assert sorted(agent_id for share in found for agent_id in share) == sorted(places_m)
    assert all(list(share) == sorted(share) for share in found)
    assert max(map(len, found)) - min(map(len, found)) <= 1
    # The order of the places does not matter.
    assert allocate(starts_m, dict(reversed(places_m.items()))) == found


@given(COSTS, st.data())
def test_who_has_some_already_is_given_fewer(costs: list[list[int]], data: st.DataObject) -> None:
    """No division with sizes as even as possible, the fixed rows included, costs less."""
    owners = len(costs[0])
    fixed_counts = data.draw(st.lists(st.integers(0, 3), min_size=owners, max_size=owners))

    def sizes(owner_of: list[int]) -> list[int]:
        return sorted(has + owner_of.count(owner) for owner, has in enumerate(fixed_counts))

    def cost(owner_of: list[int]) -> int:
        return sum(row[owner] for row, owner in zip(costs, owner_of, strict=True))

    divisions = [list(it) for it in product(range(owners), repeat=len(costs))]
    evenest = min(sum(size**2 for size in sizes(it)) for it in divisions)
    found = min_cost_assignment(np.array(costs, dtype=np.int64), fixed_counts)
    assert sum(size**2 for size in sizes(found)) == evenest
    assert cost(found) == min(cost(it) for it in divisions if sum(n**2 for n in sizes(it)) == evenest)


@given(
    st.lists(POINTS, min_size=1, max_size=4),
    st.dictionaries(st.integers(1, 99), POINTS, max_size=16),
    st.data(),
)
def test_who_stays_stays(
    starts_m: list[tuple[float, float]], places_m: dict[int, tuple[float, float]], data: st.DataObject
) -> None:
    keepers = st.integers(0, len(starts_m) - 1)
    fixed_owner_of = {it: data.draw(keepers) for it in places_m if data.draw(st.booleans())}
    found = allocate(starts_m, places_m, fixed_owner_of)
    assert sorted(agent_id for share in found for agent_id in share) == sorted(places_m)
    assert all(agent_id in found[keeper] for agent_id, keeper in fixed_owner_of.items())


HEAPS = {
    **{n: (0.0 + n, 0.0) for n in (2, 5, 7)},
    **{n: (0.0 + n, 100.0) for n in (1, 4, 8)},
    **{n: (0.0 + n, 200.0) for n in (3, 6, 9)},
}


@pytest.mark.parametrize(
    ("starts_m", "places_m", "shares"),
    [
        pytest.param(
            [(5.0, 190.0), (5.0, 10.0), (5.0, 90.0)],
            HEAPS,
            [(3, 6, 9), (2, 5, 7), (1, 4, 8)],
            id="each takes the heap that it stands beside",
        ),
        # All shares are equally good at first; the moving centres find the heaps.
        pytest.param(
            [(0.0, 0.0), (0.0, 1.0), (0.0, 2.0)],
            HEAPS,
            [(2, 5, 7), (1, 4, 8), (3, 6, 9)],
            id="from one harbour they part all the same",
        ),
        # Five lie about the first aPad and one about the second, so the farthest two of the five change over.
        pytest.param(
            [(0.0, 2.0), (0.0, 100.0)],
            {n: (0.0, n - 1.0 if n < 6 else 100.0) for n in range(1, 7)},
            [(1, 2, 3), (4, 5, 6)],
            id="nearness gives way to equal numbers",
        ),
    ],
)
def test_shares_of_simple_layouts(
    starts_m: list[tuple[float, float]],
    places_m: dict[int, tuple[float, float]],
    shares: list[tuple[int, ...]],
) -> None:
    assert list(allocate(starts_m, places_m)) == shares


def test_a_hundred_kilometres_are_exact_and_more_is_refused_as_nobody_to_serve_is() -> None:
    corner, apart = 1e5, 1e-3
    places_m = {
        1: (corner, corner),
        2: (-corner, -corner),
        3: (corner, corner - apart),
        4: (-corner, -corner + apart),
    }
    assert allocate([(-corner, 0.0), (corner, 0.0)], places_m) == ((2, 4), (1, 3))
    assert dist(places_m[1], places_m[3]) == pytest.approx(apart)
    for starts_m, far_m, why in (([(0.0, 0.0)], (2e5, 0.0), "100 km"), ([], (0.0, 0.0), "aPad")):
        with pytest.raises(ValueError, match=why):
            allocate(starts_m, {1: far_m})
