"""A mission that has to be home by a time: what it reserves, and that it is home in time with nobody aboard."""

from __future__ import annotations

import math
from dataclasses import replace
from datetime import datetime

import pytest
from hypothesis import given
from hypothesis import strategies as st
from journals import facts_of
from scenario_files import POOL_FILE

from agents.water.water_current import CurrentConfig
from apad_bridge.commands.fly.flight import with_end_by_in_seconds
from apad_bridge.events.run_events import EndReason
from apad_bridge.mission.end_by import MARGIN_S, EndBy
from apad_bridge.runs.in_memory import open_flight
from apad_bridge.scenario.errors import ScenarioError
from apad_bridge.scenario.hull_in_flow import LegForecast, Surface
from apad_bridge.scenario.loader import from_data, load, resolve
from apad_bridge.scenario.schema import Scenario
from apad_bridge.scenario.water.currents import steady_text

HOME_M = (14.0, 10.5)


def scenario(end_by: object) -> Scenario:
    data = resolve(load(POOL_FILE))
    data["mission"]["end_by"] = end_by
    data["area"]["home_m"] = list(HOME_M)
    data["fleet"]["hosting"] = "one_process"
    return from_data(data, "test")


@pytest.mark.parametrize("end_by_s", [400, 700, 1100])
def test_it_is_home_in_time_and_has_brought_back_whom_it_held(end_by_s: int) -> None:
    flight, records = open_flight(scenario(end_by_s))
    assert flight.run().reason is EndReason.END_BY and flight.now_ms <= 1000 * end_by_s
    pose = flight.supervisor.pose
    assert pose is not None and math.dist((pose.north_m, pose.east_m), HOME_M) <= 1.5
    assert flight.supervisor.mission.docks == (None, None, None, None)
    # It went on for as long as it could: what is left is what was reserved for four that took longer.
    assert flight.now_ms > 1000 * (end_by_s - 400)
    closed = sum(data["closed"] for _, kind, data in facts_of(records) if kind == "dock")
    opened = sum(not data["closed"] for _, kind, data in facts_of(records) if kind == "dock")
    assert closed == opened > 0


def test_without_one_nothing_changes_and_after_the_mission_s_time_it_never_comes_to_it() -> None:
    plain, late = scenario(None), scenario(10_000)
    ends = []
    for flown in (plain, late):
        flight, _ = open_flight(replace(flown, duration_s=600.0))
        ends.append((flight.run().reason, flight.supervisor.mission.state))
    assert ends[0] == ends[1] and ends[0][0] is EndReason.MISSION_TIME


places = st.tuples(st.floats(-500, 500), st.floats(-500, 500))


@given(places, st.lists(places, max_size=4), places)
def test_more_to_bring_back_never_leaves_more_time(
    here: tuple[float, float], releases: list[tuple[float, float]], more: tuple[float, float]
) -> None:
    """By bisection over the time. The nearest first is no shortest way, so a place may shorten it by some."""
    end_by = EndBy(100_000.0, HOME_M, 0.5, 60.0, 60.0)

    def turns_ms(places_m: list[tuple[float, float]]) -> int:
        early, late = -10_000_000, 100_000_000
        while late - early > 1:
            middle = (early + late) // 2
            early, late = (early, middle) if end_by.must_return(middle, here, places_m) else (middle, late)
        return late

    alone = turns_ms([])
    straight_s = math.dist(here, HOME_M) / (0.8 * 0.5)
    assert alone == pytest.approx(1000 * (100_000 - MARGIN_S - straight_s), abs=2)
    assert turns_ms(releases) <= alone
    assert end_by.must_return(alone, here, [*releases, more])
    assert not releases or not end_by.must_return(-10_000_000, here, releases)


@pytest.mark.parametrize(("north_m_s", "made_good_m_s"), [(0.0, 0.5), (0.8, 0.5), (-0.8, 0.2)])
def test_the_way_home_against_a_known_current_begins_earlier(
    pool: Scenario, north_m_s: float, made_good_m_s: float
) -> None:
    """The aPad makes 1 m/s through the water, of which the current leaves 0.2 to the north."""
    legs = LegForecast(pool.apad, Surface(CurrentConfig(steady_text(north_m_s, 0.0)).water_current()))
    end_by = EndBy(10_000.0, (60.0, 0.0), 0.5, 60.0, 60.0, legs)
    turns_ms = 1000 * (10_000 - MARGIN_S - 60 / (0.8 * made_good_m_s))
    assert end_by.must_return(math.ceil(turns_ms) + 1, (0.0, 0.0), [])
    assert not end_by.must_return(math.floor(turns_ms) - 1, (0.0, 0.0), [])


@pytest.mark.parametrize(
    ("now", "speed", "seconds"),
    [
        ("2026-06-01T15:00:00", 1.0, 5400.0),
        ("2026-06-01T16:29:30", 10.0, 300.0),
        ("2026-06-01T00:00:00", 1.0, 59_400.0),
    ],
)
def test_a_local_time_is_seconds_of_a_mission_that_begins_now(now: str, speed: float, seconds: float) -> None:
    flown = with_end_by_in_seconds(scenario("16:30"), datetime.fromisoformat(now), speed)
    assert flown.mission.end_by == seconds
    assert with_end_by_in_seconds(flown, datetime.fromisoformat(now)) == flown


def test_a_time_that_has_passed_or_is_none_is_refused() -> None:
    with pytest.raises(ScenarioError, match="16:30 has passed today"):
        with_end_by_in_seconds(scenario("16:30"), datetime(2026, 6, 1, 16, 30))
    for wrong in ("24:00", "16.30", "soon", 0, -5, "1630"):
        with pytest.raises(ScenarioError, match="end_by"):
            scenario(wrong)
    with pytest.raises(ScenarioError, match="say seconds"):
        open_flight(scenario("16:30"))
