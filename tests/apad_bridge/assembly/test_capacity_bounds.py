"""The bounds of a scenario by hand."""

from __future__ import annotations

import itertools
import re
from math import inf
from typing import Any

import pytest
from bounds.service_bounds import sustained_by_balance, uptime_with_services
from hypothesis import given
from hypothesis import strategies as st
from scenario_files import POOL_FILE, WHOLE_FILE
from scipy.optimize import linprog

from apad_bridge.assembly.capacity_bounds import (
    Bounds,
    Rates,
    _best_gain,
    active_minutes,
    bounds_of,
    rates_of,
    uptime_with_closing,
)
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


def test_where_motors_take_much_an_amussel_gains_most_from_empty_by_hand() -> None:
    """The backup battery carries it up; a run of 0.2 down is all that it pays of its whole charge, in Table I's 485 min."""
    scenario = resolve(pool())
    scenario["board"]["motor_run_charge"] = 0.2
    found = rates_of(from_data(scenario, "test"))[0]
    assert found.charge == pytest.approx((1 - 0.2) / 485, rel=1e-3)
    assert (
        found.charge > (1 - 0.4) / 485 > (0.4366 - 0.4) / 150
    )  # both runs from the primary: from empty, above the knee


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


FULL_ONE, HALF = (Rates(start, 0.001, 0.003, 500.0, 0.0, 0.0, 0.0) for start in (1.0, 0.5))


@pytest.mark.parametrize(
    ("fleet", "docks", "active"),
    [
        # One begins full and lasts; the other is docked for y minutes with 0.5 + 0.003 y = 0.001 (1000 - y): y = 125.
        ([FULL_ONE, HALF], 1, 1000 + 875),
        ([FULL_ONE, HALF], 0, 1000 + 500),
        # Five such share one dock's 1000 minutes, of which they could use 5 x 125.
        ([HALF] * 5, 1, 5 * 875),
        # Sixteen could use 2000: each docked minute adds three active ones.
        ([HALF] * 16, 1, 16 * 500 + 3 * 1000),
    ],
)
def test_a_mission_of_1000_minutes_by_hand(fleet: list[Rates], docks: int, active: float) -> None:
    assert active_minutes(fleet, 1000.0, docks) == pytest.approx(active)


@pytest.mark.parametrize("surfacing", [0.0, 0.05])
def test_a_board_that_never_sleeps_takes_no_samples_on_its_ways_and_in_a_closing_dock_by_hand(
    surfacing: float,
) -> None:
    """12 from a charge of 0.6 for 20 hours of theirs at theta 30, which the docks serve as they like.

    A service above the knee takes 150 min in the dock, and 9.5 more: the ways 1 each, and 15 s of closing 7.5.
    """
    data = resolve(pool())
    data["fleet"]["start"] = {"charge": [0.6, 0.6]}
    data["board"]["motor_run_charge"] = surfacing / 2
    scenario = from_data(data, "test")
    away_min = 0.4366 / C + 9.5
    gain = (0.4366 - surfacing - 9.5 * D) / away_min
    away = (1200 * D - 0.6 - surfacing / 2) / (gain + D)
    found = bounds_of([scenario])
    assert found.samples == pytest.approx(12 * (1201 - away) * 2, rel=1e-4)  # a sample every 30 s of theirs
    assert found.samples < found.active * scenario.duration_s


def test_few_services_by_hand() -> None:
    """The pool's 12 from a charge of 0.6 for 1200 minutes."""
    data = resolve(pool())
    data["fleet"]["start"] = {"charge": [0.6, 0.6]}
    scenario, time_min = from_data(data, "test"), 12 * 1200
    # Four whole batteries on top, in 1940 of the docks' minutes.
    assert uptime_with_services(scenario, 4) == pytest.approx(100 * (12 * 0.6 + 4) / D / time_min, rel=1e-3)
    # Each of seven gains the fast 0.4366 in 150 minutes, and g more at the middle rate, until no time is left.
    more_min = (time_min - (12 * 0.6 + 7 * 0.4366) / D - 7 * 0.4366 / C) / (1 + 0.00223 / D)
    docked_min = 7 * 0.4366 / C + more_min
    assert uptime_with_services(scenario, 7) == pytest.approx(100 * (1 - docked_min / time_min), rel=1e-3)
    # So many that all are on the fast part: the linear programme's bound.
    assert uptime_with_services(scenario, 99) == pytest.approx(bounds_of([scenario]).uptime_percent, rel=1e-6)


def test_a_closing_dock_charges_nobody() -> None:
    data = resolve(pool(count=24, duration_s=9600.0))
    data["fleet"]["start"] = {"charge": [0.6, 0.6]}
    time_min = 4800.0  # of the aMussels; the docks close for 7.5 of them
    assert uptime_with_closing(from_data(data, "test")) == pytest.approx(
        100 * (24 * 0.6 / D + 4 * time_min * 0.4366 / (0.4366 / C + 7.5) / D) / (24 * time_min), rel=1e-6
    )
    held = pool(count=12)  # its docks have time to close
    assert uptime_with_closing(held) == pytest.approx(bounds_of([held]).uptime_percent)


fleets = st.lists(
    st.builds(Rates, st.floats(0, 1), *[st.floats(1e-4, 1e-2)] * 2, st.just(500.0), *[st.just(0.0)] * 3),
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


MW = 1 / 7400 / 60
"""A milliwatt, as charge a minute."""
ASLEEP = 3.92756e-05 + 12.5 * MW
"""The MU asleep, and its modem listening."""
TWO_COILS, PATH, MOTOR_RUN = 0.0036198285, 0.6037, 0.0268
"""Of Table I: its primary takes 390 min through two coils; and the heavy run's fit."""
ABOVE_KNEE = 0.4366


def drain_by_hand(processing_s: int, slot: int) -> float:
    """A minute of a cycle: 10 s of sensors, the Pi, the wait for a timeslot of 5 s in frames of 300 s, 1 s of sending."""
    waits_s = (5 * slot - 10 - processing_s) % 300
    awake = 10 * (D + 160 * MW) + processing_s * (D + 1000 * MW) + waits_s * D + (D + 1487.5 * MW)
    return (awake + (3600 - 11 - processing_s - waits_s) * ASLEEP) / 3600


def charge_by_hand(drain: float) -> float:
    """Above the knee, less two runs of the motors, three minutes awake, and a report of a minute in an hour's sleep."""
    report = D + 160 * MW + 500 * MW
    docked = (report + 59 * ASLEEP) / 60 * PATH
    gained = ABOVE_KNEE - 2 * MOTOR_RUN - 3 * (D - drain)
    return gained / (ABOVE_KNEE / (TWO_COILS - docked))


def test_a_whole_board_pays_for_its_service_and_its_reports_by_hand() -> None:
    """Its start has a way down and a wake added."""
    data = resolve(load(WHOLE_FILE))
    data["fleet"].update(count=12, agent_ids=[], start={"charge": [0.6, 0.6]})
    for slot, found in enumerate(rates_of(from_data(data, "test"))):
        drain = drain_by_hand(60, slot)
        start = 0.6 + MOTOR_RUN + 2 * (D - drain) + 60 * (drain - ASLEEP)
        by_hand = (drain, charge_by_hand(drain), start)
        assert (found.drain, found.charge, found.start) == pytest.approx(by_hand, rel=1e-4)


def test_a_board_that_never_sleeps_is_awake_in_its_dock_by_hand() -> None:
    found = rates_of(awake_all_the_time(load(WHOLE_FILE)))[0]
    charge = (ABOVE_KNEE - 2 * MOTOR_RUN) / (ABOVE_KNEE / (TWO_COILS - D * PATH))
    assert (found.drain, found.charge) == pytest.approx((D, charge), rel=1e-4)


def test_services_that_are_timed_to_skip_wakes_have_a_bound_of_their_own_by_hand() -> None:
    """The board draws what sleep takes alone: between its services, and no alarm rings in its dock."""
    scenario = load(WHOLE_FILE)
    found, rates = bounds_of([scenario]), rates_of(scenario, skips_wakes=True)[0]
    gained = ABOVE_KNEE - 2 * MOTOR_RUN - 3 * (D - ASLEEP)
    charge = gained / (ABOVE_KNEE / (TWO_COILS - ASLEEP * PATH))
    assert (rates.drain, rates.charge) == (pytest.approx(ASLEEP, rel=1e-4), pytest.approx(charge, rel=1e-4))
    assert found.timed_uptime_for_ever_percent == pytest.approx(100 * charge / (charge + ASLEEP), rel=1e-4)
    assert found.timed_uptime_for_ever_percent > found.uptime_for_ever_percent
    assert "No strategy that does not time its services to skip wakes exceeds" in found.text
    assert bounds_of([pool(count=12)]).timed_uptime_percent is None


def test_a_fleet_whose_timeslots_differ_is_sustained_by_its_mean_share_by_hand() -> None:
    """With 600 s of processing the third board sends at once, and the second waits for 295 s."""
    data = resolve(load(WHOLE_FILE))
    data["board"]["whole"]["cycle"]["processing_s"] = 600
    drains = [drain_by_hand(600, slot) for slot in range(12)]
    shares = [drain / (drain + charge_by_hand(drain)) for drain in drains]
    found = bounds_of([from_data(data, "test")])
    assert found.sustained == pytest.approx(4 * 12 / sum(shares), rel=1e-4)
    assert 4 * (1 / max(shares)) < found.sustained < 4 * (1 / min(shares))


def test_a_dock_that_gives_less_than_the_board_draws_fills_nobody_from_empty() -> None:
    """With the Pi and its sensors always on, the curve's first part is a loss."""
    data = resolve(awake_all_the_time(load(WHOLE_FILE)))
    data["board"]["whole"]["power"]["kept_on"] = ["pi"]
    found, rates = bounds_of([from_data(data, "test")]), rates_of(from_data(data, "test"))[0]
    docked = (D + 1000 * MW) * PATH
    assert rates.full_charge_min == inf
    assert rates.charge == pytest.approx(
        (ABOVE_KNEE - 2 * MOTOR_RUN) / (ABOVE_KNEE / (TWO_COILS - docked)), rel=1e-4
    )
    assert (found.sustained_from_empty, found.cycles_per_apad_charge) == (4, 0)


@given(st.integers(1, 4), st.floats(1e-4, 1e-2), st.floats(1e-4, 1e-2), st.integers(1, 30))
def test_docks_that_always_charge_at_the_law_s_rate_measure_the_law(
    docks: int, drain: float, charge: float, amussels: int
) -> None:
    """Whatever the fleet's size: its balance is the docks' gain less the drain of all that are in the water."""
    minutes = 600.0
    gained = docks * charge * minutes - (amussels - docks) * drain * minutes
    law = docks * (1 + charge / drain)
    assert sustained_by_balance(amussels, gained, drain, minutes) == pytest.approx(law)


def awake_all_the_time(scenario: Scenario) -> Scenario:
    data = resolve(scenario)
    data["board"]["whole"]["cycle"] = None
    return from_data(data, "test")


def test_the_cycles_of_a_fleet_that_one_apad_affords_by_hand() -> None:
    scenario = pool(theta=1)
    battery, full_h = scenario.apad.battery, 485 / 60
    # Twelve charges one after the other in four docks: three rounds of hotel load, twelve of a dock's.
    needed_wh = full_h * (12 * battery.charging_w_per_dock + 3 * battery.hotel_w)
    found = bounds_of([scenario]).cycles_per_apad_charge
    assert found == pytest.approx(battery.capacity_wh / needed_wh, rel=1e-3)


@given(*(st.floats(0.001, 1e5) for _ in range(5)))
def test_no_printed_bound_is_below_its_value(
    uptime: float, active: float, samples: float, for_ever: float, sustained: float
) -> None:
    timed = (uptime, for_ever)
    text = Bounds(9, 4, uptime, active, samples, sustained, sustained, for_ever, *timed, None).text
    numbers = [float(it) for it in re.findall(r"\d+\.?\d*", text)]
    assert (numbers[6], numbers[-1]) == (4, 9)
    for printed, value, step in zip(
        (*numbers[:6], *numbers[7:9]),
        (uptime, active, samples, for_ever, *timed, sustained, sustained),
        (0.1, 0.01, 1, 0.1, 0.1, 0.1, 0.1, 0.1),
        strict=True,
    ):
        assert value - 2e-6 <= printed < value + 1.001 * step
