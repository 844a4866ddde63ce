"""The first plan of a mission, without commands to the vehicle or the aMussels."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from apad_bridge.events.mission_events import PlanMade
from apad_bridge.runs.dry_run import first_plan
from apad_bridge.runs.in_memory import fly_in_memory
from apad_bridge.scenario.loader import load
from apad_bridge.scenario.schema import Scenario

SCENARIOS = Path(__file__).parents[3] / "launch_scripts" / "scenarios"


def shipped(name: str, duration_s: float) -> Scenario:
    return replace(load(SCENARIOS / f"{name}.yaml"), duration_s=duration_s)


@pytest.mark.parametrize(("name", "duration_s"), [("pool-12", 300.0), ("sound-12", 1800.0)])
def test_it_is_the_plan_that_a_flight_makes(name: str, duration_s: float) -> None:
    scenario = shipped(name, duration_s)
    plan = first_plan(scenario)
    _, recorder = fly_in_memory(scenario)
    made = next(recorder.journal.events(PlanMade))
    assert plan == made
    assert len(made[1].steps) == 4


def test_none_is_made_before_there_are_candidates() -> None:
    assert first_plan(shipped("whole-board-12", 60.0)) is None
