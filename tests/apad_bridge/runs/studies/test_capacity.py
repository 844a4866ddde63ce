"""The bounds of a scenario by hand, and against flights."""

from __future__ import annotations

import itertools
from dataclasses import replace
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scenario_files import POOL_FILE, WHOLE_FILE
from scipy.optimize import linprog

from apad_bridge.runs.studies.capacity import Rates, _best_gain, active_minutes, bounds_of, rates_of
from apad_bridge.runs.studies.models import Model, fly
from apad_bridge.scenario.loader import from_data, load, resolve
from apad_bridge.scenario.schema import Scenario

D, C = 0.0010427134, 0.002911
"""The paper's rates an agent minute: equation (1), and the fast end of equation (2)."""


def pool(seed: int = 1, count: int = 12, **changes: Any) -> Scenario:
    data = resolve(load(POOL_FILE))
    data["seed"] = seed
    data["fleet"].update(start={"charge": [0.6, 1.0]}, count=count, agent_ids=[])
    data["mission"].update({key: changes.pop(key) for key in list(changes) if key in data["mission"]})
    return from_data({**data, **changes}, "test")


def test_the_paper_s_fleet_by_hand() -> None:
    found = bounds_of([pool(count=24)])
    assert found.sustained == pytest.approx(4 * (1 + C / D))  # 15.2
    full_min = 0.16197 / 0.001045 + (0.5634 - 0.16197) / 0.00223 + (1 - 0.5634) / C
    assert full_min == pytest.approx(485, abs=0.1)  # Table I
    assert found.sustained_from_empty == pytest.approx(4 * (1 + 1 / full_min / D))  # 11.9
    assert found.uptime_for_ever_percent == pytest.approx(100 * 4 * C / D / 24)  # 11.17 of 24 active
    assert bounds_of([pool(count=12)]).uptime_for_ever_percent == pytest.approx(100 * C / (C + D))  # 73.6 %


def test_surfacing_lowers_what_the_docks_sustain_by_hand() -> None:
    for motor, gained in ((0.01, 0.4366 - 0.02), (0.025, 0.4366 - 0.05), (0.045, 0.4366 - 0.09)):
        scenario = resolve(pool(count=24))
        scenario["board"]["motor_run_charge"] = motor
        found = bounds_of([from_data(scenario, "test")])
        above_knee_min = 0.4366 / C  # from 0.5634 to 1
        assert found.sustained == pytest.approx(4 * (1 + gained / above_knee_min / D), rel=1e-3)
        few = bounds_of([from_data({**scenario, "fleet": {**scenario["fleet"], "count": 12}}, "test")])
        assert few.uptime_for_ever_percent == pytest.approx(100 * (1 - 4 / found.sustained), rel=1e-3)


@given(
    st.lists(st.tuples(st.floats(0.01, 1), st.floats(1e-4, 1e-2)), min_size=1, max_size=4), st.floats(0, 0.1)
)
def test_no_charge_between_two_levels_gains_more_than_the_best(
    lengths: list[tuple[float, float]], surfacing: float
) -> None:
    """Against a search of levels on a grid, which need not be breakpoints."""
    total = sum(length for length, _ in lengths)
    ends = [sum(length for length, _ in lengths[: it + 1]) / total for it in range(len(lengths))]
    curve = [(end, rate) for end, (_, rate) in zip(ends, lengths, strict=True)]

    def minutes_to(level: float) -> float:
        parts = zip([0.0, *ends], curve, strict=False)
        return sum(max(0.0, min(level, end) - low) / rate for low, (end, rate) in parts)

    best = _best_gain(curve, surfacing)
    levels = [it / 12 for it in range(13)]
    for low, high in itertools.combinations(levels, 2):
        gain = (high - low - surfacing) / (minutes_to(high) - minutes_to(low))
        assert gain <= best + 1e-9 or gain <= 0


def test_a_mission_by_hand() -> None:
    """Two aMussels, 1000 minutes: one begins full and lasts; the other begins at half, and the one dock serves it."""
    full, half = Rates(1.0, 0.001, 0.003, 500.0), Rates(0.5, 0.001, 0.003, 500.0)
    # It is docked for y minutes with 0.5 + 0.003 y = 0.001 (1000 - y): y = 125, active for 875.
    assert active_minutes([full, half], 1000.0, 1) == pytest.approx(1000 + 875)
    assert active_minutes([full, half], 1000.0, 0) == pytest.approx(1000 + 500)
    # Five such share one dock's 1000 minutes, of which they could use 5 x 125.
    assert active_minutes([half] * 5, 1000.0, 1) == pytest.approx(5 * 875)
    # Sixteen could use 2000: each docked minute adds three active ones.
    assert active_minutes([half] * 16, 1000.0, 1) == pytest.approx(16 * 500 + 3 * 1000)


fleets = st.lists(
    st.builds(Rates, st.floats(0, 1), st.floats(1e-4, 1e-2), st.floats(1e-4, 1e-2), st.just(500.0)),
    min_size=1,
    max_size=6,
)


@given(fleets, st.floats(1, 5000), st.integers(0, 4))
def test_the_closed_form_is_the_linear_programme(fleet: list[Rates], minutes: float, docks: int) -> None:
    count = len(fleet)
    constraints, limits = [], []
    for index, it in enumerate(fleet):
        energy, time = [0.0] * (2 * count), [0.0] * (2 * count)
        energy[index], energy[count + index] = it.drain, -it.charge
        time[index] = time[count + index] = 1.0
        constraints += [energy, time]
        limits += [it.start, minutes]
    constraints.append([0.0] * count + [1.0] * count)
    limits.append(docks * minutes)
    solved = linprog([-1.0] * count + [0.0] * count, A_ub=constraints, b_ub=limits)
    assert active_minutes(fleet, minutes, docks) == pytest.approx(-solved.fun, rel=1e-6, abs=1e-6)


@settings(max_examples=12, deadline=None)
@given(
    seed=st.integers(1, 10**6),
    strategy=st.sampled_from(
        ["cautious", "greedy", "none", "njnp", "edf", "shortest-order", "best-of-pool", "blend"]
    ),
    count=st.integers(1, 16),
    batch=st.integers(1, 4),
    theta=st.sampled_from([30, 120]),
    surfacing=st.sampled_from([0.0, 0.02, 0.09]),
)
def test_no_flight_exceeds_the_bounds(
    seed: int, strategy: str, count: int, batch: int, theta: int, surfacing: float
) -> None:
    board = {**resolve(pool())["board"], "motor_run_charge": surfacing / 2}
    scenario = pool(seed, count, collection=strategy, batch=batch, theta=theta, board=board)
    bounds, flown = bounds_of([scenario]), fly(scenario, Model.EVENT_DRIVEN)
    tick = 1 / scenario.duration_s
    assert flown.uptime_paper_mean <= bounds.uptime_percent + 100 * tick
    assert flown.active_mean <= bounds.active + count * tick
    assert bounds.samples is not None and flown.samples_taken <= bounds.samples + count


def test_a_whole_board_s_bounds_follow_its_duty_cycle() -> None:
    scenario = load(WHOLE_FILE)
    asleep, awake = bounds_of([scenario]), bounds_of([awake_all_the_time(scenario)])
    kf = rates_of(scenario)[0].drain / rates_of(awake_all_the_time(scenario))[0].drain
    docks = scenario.apad.docks
    assert asleep.sustained == pytest.approx(docks * (1 + (awake.sustained / docks - 1) / kf), rel=0.05)
    flown = fly(replace_duration(scenario, 600.0), Model.MISSION)
    bounds = bounds_of([scenario], 600.0)
    assert bounds.samples is not None and flown.samples_taken <= bounds.samples
    assert flown.uptime_paper_mean <= bounds.uptime_percent + 100 / 600


def awake_all_the_time(scenario: Scenario) -> Scenario:
    data = resolve(scenario)
    data["board"]["whole"]["cycle"] = None
    return from_data(data, "test")


def replace_duration(scenario: Scenario, duration_s: float) -> Scenario:
    return replace(scenario, duration_s=duration_s)


def test_the_cycles_of_a_fleet_that_one_apad_affords_by_hand() -> None:
    scenario = pool(theta=1)
    battery, full_h = scenario.apad.battery, 485 / 60
    # Twelve charges one after the other in four docks: three rounds of hotel load, twelve of a dock's.
    needed_wh = full_h * (12 * battery.charging_w_per_dock + 3 * battery.hotel_w)
    found = bounds_of([scenario]).cycles_per_apad_charge
    assert found == pytest.approx(battery.capacity_wh / needed_wh, rel=1e-3)
