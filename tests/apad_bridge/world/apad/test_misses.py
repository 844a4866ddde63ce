"""Dockings miss with the stated probability, and alike for every stack."""

from __future__ import annotations

import pytest

from apad_bridge.world.apad.dock_mechanisms import Misses


@pytest.mark.parametrize(("probability", "least", "most"), [(0.0, 0, 0), (0.25, 440, 560), (1.0, 2000, 2000)])
def test_as_often_as_is_said(probability: float, least: int, most: int) -> None:
    """Five standard deviations of the binomial about 500 of 2000 are 97; this is one fixed draw."""
    misses = Misses(7, probability)
    assert least <= sum(misses.misses(agent_id) for agent_id in range(20) for _ in range(100)) <= most


def test_it_matters_not_who_else_tries_in_between() -> None:
    alone, among = Misses(7, 0.5), Misses(7, 0.5)
    for _ in range(50):
        among.misses(3)
        assert alone.misses(4) == among.misses(4)


def test_another_seed_misses_others() -> None:
    one, other = Misses(1, 0.5), Misses(2, 0.5)
    assert [one.misses(4) for _ in range(64)] != [other.misses(4) for _ in range(64)]
