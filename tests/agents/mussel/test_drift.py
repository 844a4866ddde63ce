"""The random step: uniform, independent between axes, agents, seeds and steps, and the same in any order."""

from __future__ import annotations

from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from agents.fleet_config import resting_on_bottom
from agents.mussel.body import Body, BodyConfig, WaterConfig, drift_step_um
from agents.water.fields import WaterFields
from agents.water.patches import CALM
from agents.water.water_current import STILL
from firmware_model.actions import Buoyancy
from firmware_model.sinking import Sinking

words = st.integers(0, 2**64 - 1)


@given(words, words, words, st.integers(0, 10**9))
def test_steps_stay_within_the_amplitude(seed: int, agent_id: int, n: int, amplitude_um: int) -> None:
    north, east = drift_step_um(seed, agent_id, n, amplitude_um)
    assert -amplitude_um <= north <= amplitude_um and -amplitude_um <= east <= amplitude_um


def test_golden_steps() -> None:
    r"""Stored runs depend on these: a change here changes every recorded drift.

    The first from blake2b-128 of seed, id and n as three little-endian words, done by hand with coreutils:
    printf '\1\0\0\0\0\0\0\0\7\0\0\0\0\0\0\0\52\0\0\0\0\0\0\0' | b2sum -l 128
    """
    assert drift_step_um(1, 7, 42, 5000) == (-3105, 2860)


@pytest.mark.parametrize("axis", [0, 1])
def test_steps_are_uniform(axis: int) -> None:
    counts = [0] * 11  # amplitude 5: every integer from -5 to 5, 1000 of each expected
    for n in range(11_000):
        counts[drift_step_um(3, 12, n, 5)[axis] + 5] += 1
    assert sum((count - 1000) ** 2 / 1000 for count in counts) < 29.59  # chi-square, 10 d.o.f., p = 0.001


def test_north_and_east_are_independent_and_so_are_steps_agents_and_seeds() -> None:
    def series(seed: int, agent_id: int, axis: int) -> list[int]:
        return [1 if drift_step_um(seed, agent_id, n, 5000)[axis] > 0 else -1 for n in range(10_000)]

    one = series(3, 12, 0)
    others = (series(3, 12, 1), series(3, 13, 0), series(4, 12, 0))
    for other in others:
        assert (
            abs(sum(a * b for a, b in zip(one, other, strict=True))) < 330
        )  # 3.3 sigma of 10 000 coin tosses
    assert abs(sum(a * b for a, b in pairwise(one))) < 330


def blown(seconds: int, cuts: list[int]) -> list[tuple[int, int]]:
    """Places (um) each second of a body in still water and a wind, which surfaces from 3 m within 10 s, and is docked at
    30 s; time is also cut at `cuts` (ms)."""
    config = BodyConfig(Sinking(3_000_000, 10_000, 10_000), False, 0, leeway_um_s=(150_000, -60_000))
    water = WaterConfig(
        1, 1000, config, STILL, WaterFields.by_key({key: waters.field() for key, waters in CALM.items()})
    )
    body = Body(7, water, resting_on_bottom(0.0, 0.0, 3.0, 1.0, 1.0), 0)
    assert body.drift_due_ms is None  # at rest on the bottom
    body.run_buoyancy(Buoyancy.FLOAT, 0)
    places = []
    for now_ms in sorted({*range(1000, 1000 * seconds + 1, 1000), *cuts}):
        while (due_ms := body.drift_due_ms) is not None and due_ms <= now_ms:
            body.drift(due_ms)
        if now_ms == 30_000:
            body.dock(body.north_um, body.east_um, now_ms)
        if now_ms % 1000 == 0:
            places.append((body.north_um, body.east_um))
    return places


@given(st.lists(st.integers(1, 39_999), max_size=20))
def test_wind_moves_what_floats_and_nothing_else(cuts: list[int]) -> None:
    places = blown(40, cuts)
    assert places[8] == (0, 0)  # on its way up
    # From the tenth second on at the surface: 21 steps until the dock holds it.
    assert places[29] == (21 * 150_000, 21 * -60_000) and places[39] == places[29]
