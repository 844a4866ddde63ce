"""The bounds of a scenario by hand."""

from __future__ import annotations

import itertools
import re
from collections.abc import Callable
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


Row = tuple[Any, Any]
"""A bound, or several, and the same by hand."""
FULL_MIN = 0.16197 / 0.001045 + (0.5634 - 0.16197) / 0.00223 + (1 - 0.5634) / C
"""From empty to full: 485 min in Table I."""
ABOVE_KNEE = 0.4366
"""From 0.5634 to 1, where a charge is fastest."""


def pool(
    count: int = 12, start: tuple[float, float] = (0.6, 1.0), motor_run: float = 0.0, **changes: Any
) -> Scenario:
    data = resolve(load(POOL_FILE))
    data["fleet"].update(start={"charge": list(start)}, count=count, agent_ids=[])
    data["board"]["motor_run_charge"] = motor_run
    return from_data({**data, **changes}, "test")


LOW = (0.6, 0.6)
FEW = pool(start=LOW)
"""12 that begin with 0.6, for 1200 minutes of theirs."""
FEW_MIN = 12 * 1200
CROWD = pool(count=24, start=LOW, duration_s=9600.0)
"""For 4800 minutes of theirs; its docks close for 7.5 of them."""


def sustained_by_hand(motor_run: float) -> float:
    """Each run of the motors lowers what a charge above the knee gains."""
    return 4 * (1 + (ABOVE_KNEE - 2 * motor_run) / (ABOVE_KNEE / C) / D)


def sampled(motor_run: float) -> Row:
    """A board that never sleeps takes no samples on its ways and in a closing dock.

    A service above the knee takes 150 min in the dock, and 9.5 more: the ways 1 each, and 15 s of closing 7.5.
    """
    gain = (ABOVE_KNEE - 2 * motor_run - 9.5 * D) / (ABOVE_KNEE / C + 9.5)
    away = (1200 * D - 0.6 - motor_run) / (gain + D)
    # A sample every 30 s of theirs.
    return bounds_of([pool(start=LOW, motor_run=motor_run)]).samples, 12 * (1201 - away) * 2


def seven_services() -> Row:
    """Each of seven gains the fast 0.4366 in 150 minutes, and more at the middle rate, until no time is left."""
    more_min = (FEW_MIN - (12 * 0.6 + 7 * ABOVE_KNEE) / D - 7 * ABOVE_KNEE / C) / (1 + 0.00223 / D)
    docked_min = 7 * ABOVE_KNEE / C + more_min
    return uptime_with_services(FEW, 7), 100 * (1 - docked_min / FEW_MIN)


def cycles() -> Row:
    """Twelve charges one after the other in four docks: three rounds of hotel load, twelve of a dock's."""
    scenario, full_h = pool(theta=1), FULL_MIN / 60
    battery = scenario.apad.battery
    needed_wh = full_h * (12 * battery.charging_w_per_dock + 3 * battery.hotel_w)
    return bounds_of([scenario]).cycles_per_apad_charge, battery.capacity_wh / needed_wh


MW = 1 / 7400 / 60
"""A milliwatt, as charge a minute."""
ASLEEP = 3.92756e-05 + 12.5 * MW
"""The MU asleep, and its modem listening."""
TWO_COILS, PATH, MOTOR_RUN = 0.0036198285, 0.6037, 0.0268
"""Of Table I: its primary takes 390 min through two coils; and the heavy run's fit."""


def whole(kept_on: tuple[str, ...] = (), **cycle: Any) -> Scenario:
    """12 whole boards that begin with 0.6; without a cycle they never sleep."""
    data = resolve(load(WHOLE_FILE))
    data["fleet"].update(count=12, agent_ids=[], start={"charge": [0.6, 0.6]})
    own = data["board"]["whole"]
    own["cycle"] = {**own["cycle"], **cycle} if cycle else None
    own["power"]["kept_on"] = list(kept_on)
    return from_data(data, "test")


def drain_by_hand(processing_s: int, slot: int) -> float:
    """A minute of a cycle: 10 s of sensors, the Pi, the wait for a timeslot of 5 s in frames of 300 s, 1 s of sending."""
    waits_s = (5 * slot - 10 - processing_s) % 300
    awake = 10 * (D + 160 * MW) + processing_s * (D + 1000 * MW) + waits_s * D + (D + 1487.5 * MW)
    return (awake + (3600 - 11 - processing_s - waits_s) * ASLEEP) / 3600


def charge_by_hand(awake: float, docked: float) -> float:
    """Above the knee, less two runs of the motors, three minutes awake, and what the board draws in its dock."""
    return (ABOVE_KNEE - 2 * MOTOR_RUN - 3 * awake) / (ABOVE_KNEE / (TWO_COILS - docked * PATH))


REPORTS = (D + 160 * MW + 500 * MW + 59 * ASLEEP) / 60
"""In a dock: a report of a minute in an hour's sleep."""
ONCE = whole(processing_s=60)
TIMED = charge_by_hand(D - ASLEEP, ASLEEP)
"""Services that are timed to skip wakes: no alarm rings in a dock."""


def rates(scenario: Scenario, **how: bool) -> list[tuple[float, float]]:
    return [(it.drain, it.charge) for it in rates_of(scenario, **how)]


def each_board() -> Row:
    """A whole board pays for its service and its reports; its start has a way down and a wake added."""
    by_hand: list[float] = []
    for slot in range(12):
        drain = drain_by_hand(60, slot)
        start = 0.6 + MOTOR_RUN + 2 * (D - drain) + 60 * (drain - ASLEEP)
        by_hand += [drain, charge_by_hand(D - drain, REPORTS), start]
    return [found for it in rates_of(ONCE) for found in (it.drain, it.charge, it.start)], by_hand


def mean_share() -> Row:
    """With 600 s of processing the third board sends at once, and the second waits for 295 s."""
    drains = [drain_by_hand(600, slot) for slot in range(12)]
    shares = [drain / (drain + charge_by_hand(D - drain, REPORTS)) for drain in drains]
    return bounds_of([whole(processing_s=600)]).sustained, 4 * 12 / sum(shares)


PI = whole(kept_on=("pi",))
"""With the Pi and its sensors always on, a dock gives less than the board draws up to the knee."""
BY_HAND: dict[str, Callable[[], Row]] = {
    "docks sustain 15.2": lambda: (bounds_of([pool(count=24)]).sustained, 4 * (1 + C / D)),
    "from empty docks sustain 11.9": lambda: (
        bounds_of([pool(count=24)]).sustained_from_empty,
        4 * (1 + 1 / FULL_MIN / D),
    ),
    "11.17 of 24 are active": lambda: (
        bounds_of([pool(count=24)]).uptime_for_ever_percent,
        100 * 4 * C / D / 24,
    ),
    "73.6 % of 12": lambda: (bounds_of([pool()]).uptime_for_ever_percent, 100 * C / (C + D)),
    **{
        f"motors that take {it} lower what docks sustain": lambda it=it: (
            bounds_of([pool(count=24, motor_run=it)]).sustained,
            sustained_by_hand(it),
        )
        for it in (0.01, 0.025, 0.045)
    },
    **{
        f"motors that take {it} lower the uptime": lambda it=it: (
            bounds_of([pool(motor_run=it)]).uptime_for_ever_percent,
            100 * (1 - 4 / sustained_by_hand(it)),
        )
        for it in (0.01, 0.025, 0.045)
    },
    # The backup battery carries it up; a run of 0.2 down is all that it pays of its whole charge. With both runs of the
    # primary it would gain less: from empty, and above the knee.
    "where motors take much it gains most from empty": lambda: (
        rates_of(pool(motor_run=0.2))[0].charge,
        (1 - 0.2) / FULL_MIN,
    ),
    "samples": lambda: sampled(0.0),
    "samples of one that surfaces": lambda: sampled(0.025),
    # Four whole batteries on top, in 1940 of the docks' minutes.
    "four services": lambda: (uptime_with_services(FEW, 4), 100 * (12 * 0.6 + 4) / D / FEW_MIN),
    "seven services": seven_services,
    # So many that all are on the fast part: the linear programme's bound.
    "99 services": lambda: (uptime_with_services(FEW, 99), bounds_of([FEW]).uptime_percent),
    "a closing dock charges nobody": lambda: (
        uptime_with_closing(CROWD),
        100 * (24 * 0.6 / D + 4 * 4800 * ABOVE_KNEE / (ABOVE_KNEE / C + 7.5) / D) / (24 * 4800),
    ),
    "docks that have time to close": lambda: (
        uptime_with_closing(pool()),
        bounds_of([pool()]).uptime_percent,
    ),
    "cycles that an aPad's charge affords": cycles,
    "a whole board pays for its service": each_board,
    "boards that never sleep are awake in their docks": lambda: (
        [*rates(whole())[0]],
        [D, charge_by_hand(0.0, D)],
    ),
    "services that skip wakes": lambda: ([*rates(ONCE, skips_wakes=True)[0]], [ASLEEP, TIMED]),
    "their uptime": lambda: (
        bounds_of([ONCE]).timed_uptime_for_ever_percent,
        100 * TIMED / (TIMED + ASLEEP),
    ),
    "a fleet whose timeslots differ is sustained by its mean share": mean_share,
    "a dock that gives less than the board draws fills nobody from empty": lambda: (
        [rates_of(PI)[0].full_charge_min, rates_of(PI)[0].charge],
        [inf, charge_by_hand(0.0, D + 1000 * MW)],
    ),
    "and sustains whom it holds alone": lambda: (bounds_of([PI]).sustained_from_empty, 4),
    "and affords no cycle": lambda: (bounds_of([PI]).cycles_per_apad_charge, 0),
}


@pytest.mark.parametrize("row", BY_HAND.values(), ids=BY_HAND)
def test_a_bound_by_hand(row: Callable[[], Row]) -> None:
    found, by_hand = row()
    assert found == pytest.approx(by_hand)


def test_no_bound_of_services_that_skip_wakes_is_told_where_boards_do_not_sleep() -> None:
    assert "No strategy that does not time its services to skip wakes exceeds" in bounds_of([ONCE]).text
    assert bounds_of([pool()]).timed_uptime_percent is None


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


@given(st.integers(1, 4), st.floats(1e-4, 1e-2), st.floats(1e-4, 1e-2), st.integers(1, 30))
def test_docks_that_always_charge_at_the_law_s_rate_measure_the_law(
    docks: int, drain: float, charge: float, amussels: int
) -> None:
    """Whatever the fleet's size: its balance is the docks' gain less the drain of all that are in the water."""
    minutes = 600.0
    gained = docks * charge * minutes - (amussels - docks) * drain * minutes
    law = docks * (1 + charge / drain)
    assert sustained_by_balance(amussels, gained, drain, minutes) == pytest.approx(law)


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
