"""Flights of the studies' models stay below the bounds of their scenarios."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from bounds.service_bounds import uptime_with_services
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scenario_files import POOL_FILE, WHOLE_FILE

from apad_bridge.assembly.capacity_bounds import active_minutes, bounds_of, rates_of
from apad_bridge.scenario.loader import from_data, load, resolve
from apad_bridge.studies.models import Model, fly


@settings(max_examples=12, deadline=None)
@given(
    seed=st.integers(1, 10**6),
    strategy=st.sampled_from(
        ["cautious", "greedy", "none", "njnp", "edf", "shortest-order", "best-of-pool", "blend"]
    ),
    count=st.integers(1, 16),
    batch=st.integers(1, 4),
    theta=st.sampled_from([30, 120]),
    surfacing=st.sampled_from([0.0, 0.02, 0.09, 0.3]),
    horizon=st.sampled_from(["open", "end"]),
    rules=st.sampled_from(
        [{}, {"dispatch": "asynchronous", "places": "exchanged", "pool_threshold": 0.5, "charge_to": 0.9}]
    ),
)
def test_no_flight_exceeds_the_bounds(
    seed: int,
    strategy: str,
    count: int,
    batch: int,
    theta: int,
    surfacing: float,
    horizon: str,
    rules: dict[str, Any],
) -> None:
    data = {**resolve(load(POOL_FILE)), "seed": seed, "theta": theta}
    data["board"]["motor_run_charge"] = surfacing / 2
    data["fleet"].update(start={"charge": [0.6, 1.0]}, count=count, agent_ids=[])
    data["mission"].update(collection=strategy, batch=batch, horizon=horizon, **rules)
    scenario = from_data(data, "test")
    bounds, flown = bounds_of([scenario]), fly(scenario, Model.EVENT_DRIVEN)
    tick = 1 / scenario.duration_s
    assert flown.uptime_paper_mean <= bounds.uptime_percent + 100 * tick
    assert flown.active_mean <= bounds.active + count * tick
    served = uptime_with_services(scenario, flown.services + 4)  # four may be docked at the end
    assert flown.uptime_paper_mean <= served + 100 * tick
    assert bounds.samples is not None and flown.samples_taken <= bounds.samples + count


def test_flights_of_whole_boards_stay_below_their_bounds() -> None:
    scenario = replace(load(WHOLE_FILE), duration_s=600.0)
    bounds, flown = bounds_of([scenario]), fly(scenario, Model.MISSION)
    assert bounds.samples is not None and flown.samples_taken <= bounds.samples
    assert flown.uptime_paper_mean <= bounds.uptime_percent + 100 / 600


@settings(max_examples=8, deadline=None)
@example(processing_s=1500, start=0.05, hours=3)
@given(processing_s=st.sampled_from([0, 600, 1500]), start=st.floats(0.01, 0.2), hours=st.integers(2, 8))
def test_no_flight_exceeds_the_bounds_by_ending_just_before_a_wake(
    processing_s: int, start: float, hours: int
) -> None:
    """A wake of 1500 s takes as much as twenty hours of sleep: a board lives longer than its start over its mean drain."""
    data = resolve(load(WHOLE_FILE))
    data["board"]["whole"]["cycle"]["processing_s"] = processing_s
    data["fleet"].update(count=3, agent_ids=[], start={"charge": [start, start]})
    data["mission"].update(collection="none", batch=1)
    scenario = from_data({**data, "duration_s": hours * 120}, "test")
    undocked = active_minutes(rates_of(scenario), hours * 60, 0) / (3 * hours * 60)
    assert fly(scenario, Model.MISSION).uptime_paper_mean <= 100 * (undocked + 1 / scenario.duration_s)
