"""One sea pushes the aMussels and the aPad; a leg that cannot be made is told before the flight and in it."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import pytest
from journals import facts_of

from apad_bridge.assembly import flight_parts
from apad_bridge.assembly.safety import LegEnergy, safety_of
from apad_bridge.records.failure_counts import FailureCounts
from apad_bridge.runs.in_memory import MemoryRecorder, open_flight
from apad_bridge.scenario.blocks.guard_options import GuardOptions
from apad_bridge.scenario.cross_checks import contradictions
from apad_bridge.scenario.flight_readiness import warnings
from apad_bridge.scenario.hull_in_flow import fastest_drift_m_s
from apad_bridge.scenario.schema import DriftMode, Scenario
from apad_bridge.scenario.starts import starts_of
from apad_bridge.scenario.water.water_options import Current, Water, Wind
from apad_bridge.supervisor.loop import Flight
from apad_bridge.vehicle.commands import Hold


def in_current(pool: Scenario, north_m_s: float) -> Scenario:
    drift = replace(pool.fleet.drift, mode=DriftMode.PHYSICAL, amplitude_m=0.0, current_m_s=(north_m_s, 0.0))
    return replace(pool, fleet=replace(pool.fleet, drift=drift))


def flown(scenario: Scenario) -> tuple[Flight, MemoryRecorder]:
    flight, recorder = open_flight(scenario)
    flight.run()
    return flight, recorder


def battery(flight: Flight) -> float:
    return flight.supervisor.battery.fraction


def test_the_pool_in_a_current_has_its_services_at_a_higher_price(pool: Scenario) -> None:
    (calm, _), (moved, recorder) = flown(in_current(pool, 0.0)), flown(in_current(pool, 0.2))
    assert moved.supervisor.mission.state.services == calm.supervisor.mission.state.services == 16
    # It rests for most of the 40 minutes, at 1.6 N and 13.6 W: 3.9 % of its battery. Going costs more, too.
    assert 0.03 < battery(calm) - battery(moved) < 0.05
    assert not [it for it in facts_of(recorder) if it[1] == "beyond_reach"]


def test_the_plans_of_a_mission_cost_by_the_sea_where_they_may_know_it(pool: Scenario) -> None:
    short = in_current(replace(pool, duration_s=900.0), 0.2)
    ignorant = replace(short, mission=replace(short.mission, costs=replace(short.mission.costs, flow=False)))

    def ways(scenario: Scenario) -> list[tuple[float, float]]:
        _, recorder = flown(scenario)
        plans = [data["costs"] for _, kind, data in facts_of(recorder) if kind == "plan"]
        return [(it["distance_m"], it["distance_cost"]) for it in plans]

    known, over_ground = ways(short), ways(ignorant)
    # Cautious does not look at the way: it flies the same, and only the costs differ.
    assert [it for it, _ in known] == [it for it, _ in over_ground]
    assert all(cost == metres for metres, cost in over_ground) and len(known) >= 2
    # With the current a metre takes (0.3 / 0.5)^2 of a calm one's energy, and against it (0.7 / 0.5)^2.
    assert all(0.36 <= cost / metres <= 1.96 and cost != metres for metres, cost in known)


def test_the_guards_know_the_sea_of_the_scenario(pool: Scenario) -> None:
    """An aPad without thrust goes with it; the way home against it takes more of the battery; a docking more room."""
    guards = GuardOptions(battery_reserve=0.2, drift_m_s=0.1)
    still, moved = (replace(in_current(pool, it), guards=guards) for it in (0.0, 0.3))
    assert safety_of(moved).drift_m_s((5.0, 5.0), 0) == pytest.approx((0.3, 0.0))
    assert safety_of(still).drift_m_s((5.0, 5.0), 0) == (0.0, 0.0)
    measured = replace(pool, guards=guards, apad=replace(pool.apad, drift_m_s=(0.05, 0.1)))
    assert safety_of(measured).drift_m_s((5.0, 5.0), 0) == (0.05, 0.1)

    north, south = LegEnergy.of(moved), LegEnergy.of(still)
    ends = (0.0, 0.0), (100.0, 0.0)
    # 200 s at 25 W and 6 W for each of 4 x F / (2 sqrt 2) N, where F is 40 times the square of the speed through the water
    for energy, begin, end, through_m_s in (
        (north, *ends, 0.2),
        (north, *ends[::-1], 0.8),
        (south, *ends, 0.5),
        (south, *ends[::-1], 0.5),
    ):
        watts = 25 + 6 * 4 * 40 * through_m_s**2 / (2 * math.sqrt(2))
        assert energy.fraction(begin, end, 0) == pytest.approx(watts * 200 / 3600 / 230)
    assert fastest_drift_m_s(moved) == pytest.approx(0.3) and fastest_drift_m_s(still) == 0.0


def can_be_met(place_m: tuple[float, float], start_m: tuple[float, float], north_m_s: float) -> bool:
    """By trial: at some time a leg at 0.5 m/s over ground, and as much through the water, has come to the float."""
    for tenths in range(26, 20_000):
        after_s = tenths / 10
        north_m = place_m[0] + north_m_s * after_s - start_m[0]
        east_m = place_m[1] - start_m[1]
        over_ground_m_s = math.hypot(north_m, east_m) / (after_s - 2.5)
        if over_ground_m_s <= 0.5:
            to_north, to_east = (it / math.hypot(north_m, east_m) for it in (north_m, east_m))
            # Of all speeds over ground on that line, one at least is 0.5 m/s through the water or less.
            return any(
                math.hypot(speed / 100 * to_north - north_m_s, speed / 100 * to_east) <= 0.5
                for speed in range(1, 300)
            )
    return False


def test_a_current_beyond_the_hull_is_told_before_and_in_the_mission(pool: Scenario) -> None:
    slow = replace(pool, duration_s=60.0, apad=replace(pool.apad, max_speed_m_s=0.5))
    fast = in_current(slow, 0.6)
    told = [happens for happens, _ in warnings(fast)]
    assert any("makes no way against a current of 0.60 m/s" in it for it in told), told
    assert not any("makes no way" in it for it, _ in warnings(in_current(slow, 0.4)))

    _, recorder = flown(fast)
    first_ms = min(at_ms for at_ms, kind, _ in facts_of(recorder) if kind == "beyond_reach")
    beyond = {
        data["agent"]
        for at_ms, kind, data in facts_of(recorder)
        if (at_ms, kind) == (first_ms, "beyond_reach")
    }
    start_m = pool.apad.start_m
    expected = {
        it.agent_id for it in starts_of(fast) if not can_be_met((it.north_m, it.east_m), start_m, 0.6)
    }
    assert first_ms <= 2000 and beyond == expected and 0 < len(expected) < 12

    counts = FailureCounts()
    for at_ms, event in recorder.journal.entries:
        counts.take(at_ms, event)
    assert set(counts.figures()["beyond_reach"]) >= expected


@pytest.mark.parametrize("build", [flight_parts.simulated_apad, flight_parts.simulated_hull])
def test_the_node_and_the_flight_in_one_process_have_one_hull_in_one_sea(pool: Scenario, build: Any) -> None:
    apad = build(in_current(pool, 0.2))
    apad.receive(Hold(1, *pool.apad.start_m), 0)
    apad.advance(60_000)
    assert math.fsum(map(abs, apad.motion.forces_n)) == pytest.approx(4 * 40 * 0.2**2 / (2 * math.sqrt(2)))


@pytest.mark.parametrize(
    "water",
    [Water(current=Current(steady_m_s=(0.1, 0.0))), Water(wind=Wind(north_m_s=3.0, east_m_s=0.0)), None],
)
def test_a_measured_drift_beside_a_current_or_a_wind_would_be_a_second_sea(
    pool: Scenario, water: Water | None
) -> None:
    scenario = in_current(pool, 0.2) if water is None else replace(pool, water=water)
    scenario = replace(scenario, apad=replace(scenario.apad, drift_m_s=(0.1, 0.0)))
    (message,) = [text for key, text in contradictions(scenario) if key == "apad.drift_m_s"]
    assert "there is one sea" in message
