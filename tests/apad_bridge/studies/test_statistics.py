"""A study's statistics against scipy, by hand, and as laws."""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from apad_bridge.studies.mission_figures import COLUMNS
from apad_bridge.studies.statistics import holm, standings


def rows(strategy: str, **columns: list[float | None]) -> list[dict[str, Any]]:
    count = max(len(values) for values in columns.values())
    return [
        {
            "strategy": strategy,
            "seed": seed,
            **{column: columns.get(column, [0.0] * count)[seed] for column in COLUMNS},
        }
        for seed in range(count)
    ]


def test_the_order_is_by_lost_then_samples_then_metres() -> None:
    missions = [
        *rows("shortest", samples_taken=[5.0, 5.0], metres=[1.0, 1.0], amussels_lost=[1, 0]),
        *rows("longer", samples_taken=[9.0, 9.0], metres=[8.0, 8.0]),
        *rows("shorter", samples_taken=[9.0, 9.0], metres=[7.0, 7.0]),
        *rows("lazy", samples_taken=[8.0, 8.0], metres=[0.0, 0.0]),
    ]
    found = standings(missions, ["shortest", "longer", "shorter", "lazy"], "lazy", "samples_taken", 0.95)
    assert [it.strategy for it in found] == ["shorter", "longer", "lazy", "shortest"]


def test_differences_are_paired_by_seed_and_those_of_scipy() -> None:
    ours, theirs = [10.0, 21.0, 33.0, 38.0], [9.0, 20.0, 31.0, 39.0]
    missions = [*rows("a", samples_taken=ours), *rows("b", samples_taken=theirs)[::-1]]
    (a,) = (it for it in standings(missions, ["a", "b"], "b", "samples_taken", 0.95) if it.strategy == "a")
    expected = stats.ttest_rel(ours, theirs)
    interval = expected.confidence_interval(0.95)
    found = a.differences["samples_taken"]
    assert found.p == pytest.approx(expected.pvalue)
    assert (found.estimate.low, found.estimate.high) == pytest.approx((interval.low, interval.high))


def test_a_figure_that_a_mission_lacks_leaves_its_pair_out() -> None:
    missions = [
        *rows("a", metres_per_service=[None, 4.0, 6.0]),
        *rows("b", metres_per_service=[1.0, 1.0, 1.0], apad_wh=[None] * 3),
    ]
    (a,) = (it for it in standings(missions, ["a", "b"], "b", "samples_taken", 0.9) if it.strategy == "a")
    found = a.differences["metres_per_service"]
    assert found is not None and (found.estimate.count, found.estimate.mean) == (2, 4.0)
    assert a.differences["apad_wh"] is None


def test_holm_by_hand() -> None:
    assert holm([0.01, 0.04, 0.03]) == pytest.approx([0.03, 0.06, 0.06])


@given(st.lists(st.floats(0, 1), max_size=12))
def test_holm_keeps_the_order_and_lowers_nothing(p_values: list[float]) -> None:
    adjusted = holm(p_values)
    assert all(p <= found <= 1 for p, found in zip(p_values, adjusted, strict=True))
    pairs = sorted(zip(p_values, adjusted, strict=True))
    assert [found for _, found in pairs] == sorted(found for _, found in pairs)
