"""Whole flights in which aMussels drift off, are missed by docks or do not come up: all are served all the same."""

from __future__ import annotations

from dataclasses import replace

import pytest
from journals import facts_of
from scenario_files import SOUND_FILE

from apad_bridge.runs.in_memory import fly_in_memory
from apad_bridge.scenario.loader import load
from apad_bridge.scenario.schema import Scenario
from apad_bridge.scenario.water.water_options import Wind
from apad_bridge.world.apad.dock_mechanisms import MISSED


def in_wind(speed_m_s: float, seed: int) -> Scenario:
    """What floats drifts to the north at `speed_m_s`."""
    sound = load(SOUND_FILE)
    assert sound.water is not None and sound.beliefs.twin is not None
    wind = Wind(north_m_s=speed_m_s / 0.03, east_m_s=0.0)
    twin = replace(sound.beliefs.twin, current_deviation_m_s=speed_m_s)
    return replace(
        sound,
        seed=seed,
        duration_s=2300.0,
        water=replace(sound.water, wind=wind),
        beliefs=replace(sound.beliefs, twin=twin),
    )


@pytest.mark.parametrize("seed", [1, 2])
def test_in_a_drift_of_a_tenth_of_a_metre_a_second_they_are_found_and_charged(seed: int) -> None:
    figures, recorder = fly_in_memory(in_wind(0.1, seed))
    events = [(kind, data) for _, kind, data in facts_of(recorder)]
    assert any(data["phase"] == "nothing_caught" for kind, data in events if kind == "primitive")
    assert figures["services"] >= 4
    assert not any(kind == "left_alone" for kind, _ in events)


def test_one_that_half_of_the_dockings_miss_and_that_often_stays_below_is_served_in_the_end() -> None:
    sound = in_wind(0.0, seed=3)
    failing = replace(
        sound,
        duration_s=3400.0,
        apad=replace(sound.apad, dock_miss_probability=0.5),
        board=replace(sound.board, surfacing_failure_probability=0.3),
    )
    figures, recorder = fly_in_memory(failing)
    given_up = {data["agent"] for _, kind, data in facts_of(recorder) if kind == "given_up"}
    released = {data["agent"] for _, kind, data in facts_of(recorder) if kind == "released" and data["full"]}
    missed = [
        data for _, kind, data in facts_of(recorder) if kind == "primitive" and data.get("reason") == MISSED
    ]
    assert given_up and given_up <= released
    assert len(missed) > len(given_up)  # some were caught by a further try at once
    assert figures["amussels_lost"] == 0
