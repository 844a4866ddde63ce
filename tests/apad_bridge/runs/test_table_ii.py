"""The paper's Table II: its rows against an independent stepper and against random configurations."""

from pathlib import Path

import pytest

from apad_bridge.runs.in_memory import fly_in_memory
from apad_bridge.runs.studies.table_two import (
    PAPER_CAUTIOUS,
    PAPER_NO_CHARGING,
    configurations,
    percentile_of,
    row_of,
)
from apad_bridge.scenario.loader import load
from apad_bridge.scenario.starts import starts_of

SCENARIOS = Path(__file__).parents[3] / "launch_scripts/scenarios"


def stepped_uptimes(charges: list[float], theta: int, steps: int) -> list[float]:
    """Equation (3) over equation (1), literally: u_k = u_(k-1) - 0.0010427134 theta dt, dt = 1/60 min, in [0, 1]."""
    uptimes = []
    for u in charges:
        active = 0
        for _ in range(steps):
            u = min(1.0, max(0.0, u - 0.0010427134 * theta / 60))
            active += u > 0
        uptimes.append(100 * active / steps)
    return uptimes


def test_no_charging_is_the_paper_s_row_and_an_independent_stepper_s() -> None:
    scenario = load(SCENARIOS / "no-charging.yaml")
    figures, _ = fly_in_memory(scenario)
    row = row_of(figures)
    for key, paper in PAPER_NO_CHARGING.items():
        assert row[key] == pytest.approx(paper, abs=0.05), key
    assert row["cost_m"] == 0
    uptimes = stepped_uptimes([start.primary for start in starts_of(scenario)], 30, 2400)
    # One step is 0.042 points; the flight's own battery may differ from the stepper's floats by one step at most.
    assert row["mean"] == pytest.approx(sum(uptimes) / len(uptimes), abs=0.05)
    assert row["max"] == pytest.approx(max(uptimes), abs=0.05)
    assert row["min"] == pytest.approx(min(uptimes), abs=0.05)


def test_cautious_on_random_configurations_has_the_paper_s_row_inside_its_central_90_percent() -> None:
    """Speed 0.5 m/s, 20 s for dock and undock together and a cluster of 28 x 21 m are the shipped pool-12's."""
    rows = list(configurations(load(SCENARIOS / "pool-12.yaml"), 30))
    for key, paper in PAPER_CAUTIOUS.items():
        assert 5 <= percentile_of(paper, [row[key] for row in rows]) <= 95, key


def test_the_shipped_pool_loses_no_mussel_and_drives_what_it_planned() -> None:
    scenario = load(SCENARIOS / "pool-12.yaml")
    figures, recorder = fly_in_memory(scenario)
    assert (figures["amussels_lost"], figures["emptied"]) == (0, 0)
    left_full = [data["agent"] for _, kind, data in recorder.events if kind == "released" and data["full"]]
    assert figures["services"] == len(left_full) and set(left_full) == set(scenario.fleet.ids)
    legs = [data["metres"] for _, kind, data in recorder.events if kind == "leg"]
    assert figures["planned_m"] == pytest.approx(sum(legs), abs=1e-4 * len(legs))
    # Each leg ends within the victory radius of its goal, and mission time cuts the last one off.
    least_m = sum(legs[:-1]) - scenario.mission.victory_radius_m * len(legs)
    assert least_m < figures["cost_m"] < figures["planned_m"]
