"""Positions that alternate between two places are told from noise, waves, turns and jumps of one place."""

from __future__ import annotations

import math
import random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from apad_bridge.vehicle.guards.two_places import TwoPlaces


def flown(
    seconds: float, place: object, noise_m: float, rng: random.Random
) -> list[tuple[int, tuple[float, float]]]:
    """Positions at 10 Hz, 0.5 m/s to the north, shifted by `place(s)`."""
    told = []
    for n in range(int(10 * seconds)):
        s = n / 10
        north_m, east_m = place(s)  # type: ignore[operator]
        told.append((100 * n, (0.5 * s + north_m + rng.gauss(0, noise_m), east_m + rng.gauss(0, noise_m))))
    return told


@pytest.mark.parametrize("period_s", [0.2, 0.7, 2.0])
@pytest.mark.parametrize("noise_m", [0.0, 0.1, 0.2])
@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 2**32), angle=st.floats(0, math.tau))
def test_two_places_3_m_apart_are_found_within_8_s(
    period_s: float, noise_m: float, seed: int, angle: float
) -> None:
    def mux(s: float) -> tuple[float, float]:
        far = int(2 * s / period_s) % 2
        return 3.0 * far * math.cos(angle), 3.0 * far * math.sin(angle)

    found = TwoPlaces()
    apart = [found.take(*it) for it in flown(8.0, mux, noise_m, random.Random(seed))]
    assert max(apart) == pytest.approx(3.0, abs=0.7)


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 2**32))
def test_a_mux_that_chooses_by_chance_is_found(seed: int) -> None:
    rng = random.Random(seed)
    found = TwoPlaces()
    apart = [found.take(*it) for it in flown(20.0, lambda s: (3.0 * rng.randint(0, 1), 0.0), 0.05, rng)]
    assert max(apart) == pytest.approx(3.0, abs=0.7)


ONE_PLACE = {
    "noise": lambda s: (0.0, 0.0),
    "waves": lambda s: (1.5 * math.sin(math.tau * s / 4), 0.0),
    "a turn": lambda s: (0.0, 0.0) if s < 4 else (-1.0 * (s - 4), 0.5 * (s - 4)),
    "a jump": lambda s: (0.0, 0.0) if s < 4 else (5.0, 0.0),
}


@pytest.mark.parametrize("motion", ONE_PLACE)
@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 2**32), noise_m=st.sampled_from([0.0, 0.05, 0.5, 1.0]))
def test_one_place_is_not_taken_for_two(motion: str, seed: int, noise_m: float) -> None:
    found = TwoPlaces()
    assert not any(found.take(*it) for it in flown(20.0, ONE_PLACE[motion], noise_m, random.Random(seed)))
