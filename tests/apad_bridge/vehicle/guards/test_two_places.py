"""Positions that alternate between two places are told from noise, waves, turns and jumps of one place."""

from __future__ import annotations

import math
import random
from collections.abc import Callable

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from apad_bridge.vehicle.guards.two_places import TwoPlaces


def apart_m(
    seconds: float, place: Callable[[float], tuple[float, float]], noise_m: float, seed: int, hz: int = 10
) -> list[float]:
    """How far apart two places are found, by positions at `hz`, 0.5 m/s to the north, shifted by `place(s)`."""
    rng, found = random.Random(seed), TwoPlaces()
    places = [(n / hz, *place(n / hz)) for n in range(int(hz * seconds))]
    shifted = ((round(1000 * s), (0.5 * s + north_m, east_m)) for s, north_m, east_m in places)
    return [
        found.take(ms, (north_m + rng.gauss(0, noise_m), east_m + rng.gauss(0, noise_m)))
        for ms, (north_m, east_m) in shifted
    ]


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

    assert max(apart_m(8.0, mux, noise_m, seed)) == pytest.approx(3.0, abs=0.7)


@pytest.mark.parametrize(("hz", "noise_m", "within_s"), [(10, 0.4, 12.0), (2, 0.3, 20.0), (1, 0.2, 23.0)])
@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 2**32))
def test_two_noisy_receivers_are_found_at_each_rate(
    hz: int, noise_m: float, within_s: float, seed: int
) -> None:
    found = apart_m(within_s, lambda s: (3.0 * (int(s / 2) % 2), 0.0), noise_m, seed, hz)
    assert max(found) == pytest.approx(3.0, abs=0.7)


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 2**32))
def test_a_mux_that_chooses_by_chance_is_found(seed: int) -> None:
    rng = random.Random(seed)
    found = apart_m(20.0, lambda s: (3.0 * rng.randint(0, 1), 0.0), 0.05, seed)
    assert max(found) == pytest.approx(3.0, abs=0.7)


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
    assert not any(apart_m(20.0, ONE_PLACE[motion], noise_m, seed))


@pytest.mark.parametrize("seed", [5, 1001, 1325])
def test_noise_at_1_hz_is_not_taken_for_two(seed: int) -> None:
    """Seeds whose 20 positions come to two clusters once within the time, which the next positions part."""
    waves = lambda s: (0.3 * math.sin(math.tau * s / 6), 0.0)  # noqa: E731
    assert not any(apart_m(200.0, waves, 0.5, seed, 1))
