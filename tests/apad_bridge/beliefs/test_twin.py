from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import fields, replace
from math import sqrt
from typing import Any

import numpy as np
import pytest

from agents.time_scale import TimeScale
from apad_bridge.beliefs.belief import Belief, Source
from apad_bridge.beliefs.measurement import (
    Docked,
    Fixed,
    HandedOver,
    Measurement,
    Permitted,
    Ranged,
    Rejected,
    Released,
    TimeslotSilent,
)
from apad_bridge.beliefs.modes import Mode
from apad_bridge.beliefs.spent_charge import Load
from apad_bridge.beliefs.twin import Twin
from apad_bridge.beliefs.twin_parameters import (
    CallParameters,
    ChargerParameters,
    ClockParameters,
    CycleParameters,
    Drain,
    Habits,
    Schedule,
    SensorParameters,
    TwinParameters,
    UntoldParameters,
    WaterParameters,
)
from apad_bridge.beliefs.twin_state import TwinState
from firmware_model.config import BoardConfig
from firmware_model.packets import ShortStatus, StatusPacket
from firmware_model.sinking import Sinking
from firmware_model.states import State
from firmware_model.table_one import HOURLY, WORST_CASE, board, power

HOUR = 3_600_000
_Stamped = tuple[Measurement, int]
"""A measurement and its mission time."""
ASLEEP, IDLE, HIGH = 0.00007, 0.001, 0.003
KNOWLEDGE = TwinParameters(
    scale=TimeScale(1),
    drain=Drain((ASLEEP, IDLE, HIGH, IDLE, 0.003, ASLEEP, ASLEEP, ASLEEP, 0.0), 0.027, 0.003, 0.6),
    charger=ChargerParameters(((0.16197, 0.001045), (0.5634, 0.00223), (1.0, 0.002911)), 1.2435, 0.04),
    sensor=SensorParameters(0.015, (0.0, -0.01, -0.03, 0.03), (0.004, 0.006, 0.01, 0.01), 300_000),
    habits=Habits(HOUR, 0.03, 0.6, (0.8, 0.15, 0.05), 0.0, 5 * 24 * HOUR, 0.0, 40.0),
    water=WaterParameters(0.001, 0.0, 3600.0, 1.0),
    drain_deviation=0.06,
    ageing_per_day=0.002,
    clock=ClockParameters(1000.0, 20.0, 1000.0),
    board=BoardConfig(0, WORST_CASE, 50, 2000, float_timeout_ms=12 * HOUR, release_wait_ms=0),
    sinking=Sinking(3_000_000, 60_000, 60_000),
)
ALWAYS_ASLEEP = {1: Schedule((0,), (Mode.ASLEEP,))}


def listening(motor_run_ms: int = 0, release_wait_ms: int = 0) -> BoardConfig:
    """A board that sleeps, and that listens for a minute once it rests on the bottom."""
    sleeping = board(replace(HOURLY, listen_ms=60_000), replace(power(), motor_run_ms=motor_run_ms))
    return replace(sleeping, float_timeout_ms=12 * HOUR, release_wait_ms=release_wait_ms)


def heard(
    at_ms: int, state: State, primary: float, sequence: int = 0, secondary: float = 1.0, agent_ms: int = -1
) -> _Stamped:
    agent_ms = at_ms if agent_ms < 0 else agent_ms
    return StatusPacket(1, sequence, state, primary, secondary, 3.0, 4.0, 3.0, agent_ms), at_ms


def told(twin: Twin, *measurements: _Stamped) -> Belief:
    belief: Belief | None = None
    for measurement in measurements:
        belief = twin.update(belief, *measurement)
    assert belief is not None
    return belief


def state_of(belief: Belief) -> TwinState:
    return belief.estimator_state


def hourly(state: State, start: float, drain_per_h: float, hours: int, first: int = 0) -> list[_Stamped]:
    return [
        heard((first + n) * HOUR, state, start - drain_per_h * n, sequence=first + n) for n in range(hours)
    ]


@pytest.fixture
def untaught() -> Twin:
    return Twin(KNOWLEDGE, {})


@pytest.fixture
def twin() -> Twin:
    return Twin(KNOWLEDGE, ALWAYS_ASLEEP)


@pytest.mark.parametrize(
    "measurement",
    [
        TimeslotSilent(),
        Docked(),
        Released(0.0, 0.0),
        Fixed(1.0, 2.0, 1.0),
        ShortStatus(1, State.SLEEPING, 0.5, 1.0),
    ],
)
def test_nothing_is_believed_of_one_that_was_never_heard(untaught: Twin, measurement: Measurement) -> None:
    assert untaught.update(None, measurement, 0) is None


@pytest.mark.parametrize(
    ("measurement", "at_ms", "told_so"),
    [
        pytest.param(*heard(HOUR + 500, State.ACTIVE, 0.8, 5, agent_ms=HOUR), "already", id="a duplicate"),
        pytest.param(
            *heard(HOUR + 500, State.ACTIVE, 0.85, 4, agent_ms=HOUR - 10_000), "overtook", id="a late packet"
        ),
        pytest.param(None, HOUR - 1, "time went back", id="a time before"),
    ],
)
def test_what_is_not_new_is_not_believed(
    untaught: Twin, measurement: Measurement | None, at_ms: int, told_so: str
) -> None:
    belief = told(untaught, heard(HOUR, State.ACTIVE, 0.8, 5))
    with pytest.raises((Rejected, ValueError), match=told_so):
        untaught.predict(belief, at_ms) if measurement is None else untaught.update(
            belief, measurement, at_ms
        )


def between(low: float, high: float) -> Any:
    return pytest.approx((low + high) / 2, abs=(high - low) / 2, rel=0)


def below(most: float) -> Any:
    return between(-1.0, most)


def above(least: float) -> Any:
    return between(least, 2.0)


Steps = list[tuple[Measurement | None, int, dict[Any, Any]]]
"""What comes and when, or nothing for a look, which changes no belief; and figures of the belief then."""
FIGURES: dict[Any, Callable[[Belief], Any]] = {
    "deviation": lambda it: sqrt(it.charge_cov[0]),
    "low": lambda it: it.charge_interval()[0],
    "high": lambda it: it.charge_interval()[1],
    "empty": lambda it: it.probability_at_most(0.0),
    "narrow": lambda it: (it.parts[0].weight, len(it.parts) > 1),
    "filters": lambda it: (len(it.parts), len(state_of(it).anchors)),
    "gated": lambda it: state_of(it).gated,
    "learned": lambda it: state_of(it).mean[2:6],
    "place": lambda it: (it.north_m, it.east_m),
    "place_variance": lambda it: it.place_cov[0],
    "east_variance": lambda it: it.place_cov[2],
    "lift": lambda it: state_of(it).mean[3],
    "clock": lambda it: (it.clock.drift_ppm, it.clock.offset_ms),
    "secondary_variance": lambda it: it.charge_cov[2],
    **{mode: lambda it, mode=mode: it.probability_of(mode) for mode in Mode},
}
"""Beside the fields of a belief; a mode is its probability."""


def unread(*measurements: _Stamped) -> Steps:
    return [(*it, {}) for it in measurements]


def looks(hours: range, wanted: dict[Any, Any]) -> Steps:
    return [(None, hour * HOUR, wanted) for hour in hours]


NIGHT = unread(*hourly(State.SLEEPING, 0.9, 60 * ASLEEP, 3))
POSSIBLE = {"primary": between(0, 1), "secondary": between(0, 1), "deviation": between(0, 0.51)}
UNTOLD = {"untold": UntoldParameters(0.4, 0.2, 0.05)}
WAITS = {
    "drain": replace(KNOWLEDGE.drain, release_wait=0.004, listening=0.001),
    "board": listening(motor_run_ms=60_000, release_wait_ms=120_000),
}
IN_DOCK = unread(heard(0, State.FLOATING, 0.9), (Docked(), 1000))
"""Twelve hours later it is full."""
# Its own deviation is 7e-3 before, and after the odd one 0.2.
ODD: Steps = [
    *unread(*hourly(State.SLEEPING, 0.9, 60 * ASLEEP, 5)),
    (*heard(5 * HOUR, State.SLEEPING, 0.9 - 300 * ASLEEP, 5), {"deviation": below(0.01)}),
    (*heard(6 * HOUR, State.SLEEPING, 0.2, 6), {"primary": above(0.7), "gated": 1, "deviation": above(0.1)}),
]
# Once its motors ran for the first permission, it floats.
FLOATS = 0.5 - 60 * ASLEEP - 0.027 - IDLE - 0.003 * 31 / 60
CALLS_300 = {"calls": CallParameters(300_000, 0.1)}
CALLED = unread(heard(0, State.SLEEPING, 0.6), (Permitted(), HOUR))
# Of a full battery on a charger that lifts its voltage by 0.03, and a clock that gains 30 parts in a million.
AT_THE_END = np.minimum(1.0, np.clip(1.0 + np.random.default_rng(4).normal(0, 0.015, 300), 0, 1) + 0.03)
AHEAD_MS = [2000 + round(hour * HOUR * 30e-6) for hour in range(200)]
GPS = WaterParameters(0.0, 0.1, 3600.0, 0.5, is_ground_truth=False, way_down_s=60.0)


def placed(at_ms: int, sequence: int, state: State, depth_m: float, north_m: float = 3.0) -> _Stamped:
    return StatusPacket(1, sequence, state, 0.9, 1.0, north_m, 4.0, depth_m, at_ms), at_ms


BELOW = unread(*(placed(n * HOUR, n, State.SLEEPING, 3.0) for n in range(10)))
AFLOAT = unread(*(placed(n * 10_000, n, State.FLOATING, 0.0) for n in range(5)))
TOO_SOON = unread(placed(9_999, 1, State.FLOATING, 0.0))
HOW_SURE: dict[str, tuple[WaterParameters, Steps, float, float]] = {
    # The error of the fix, and 0.1 m/s for the minute of the way down.
    "from below": (GPS, BELOW[:1], 36.25, 36.25),
    "a place repeated from below makes nobody surer": (GPS, BELOW, 36.25, 36.25),
    "fixes at the surface make surer": (GPS, AFLOAT, 0.0, 0.5**2),
    # In ten seconds it went 1 m: a variance of 1.25, which a fix of 0.25 brings to 1.25 * 0.25 / 1.5.
    "a fix ten seconds after another counts": (GPS, AFLOAT[:2], 0.207, 0.209),
    "and none a millisecond earlier": (GPS, [AFLOAT[0], *TOO_SOON], 1.24, 1.25),
    "the way down does not": (
        GPS,
        [AFLOAT[0], *unread((Docked(), 1000), (Released(3.0, 4.0), HOUR))],
        37.0,
        37.0,
    ),
    "who states where it is is believed each time": (replace(GPS, is_ground_truth=True), BELOW, 0.0, 0.05),
}
"""The water, what comes, and between which bounds the variance of the place is then."""
SCENES: dict[str, tuple[dict[str, Any], dict[int, Schedule], Steps]] = {
    # Most of the weight is one narrow Gaussian; a tail holds the unscheduled modes.
    "it goes on by the schedule and says how sure it is": (
        {},
        {1: Schedule((0, 3 * HOUR), (Mode.ASLEEP, Mode.IDLE))},
        [
            (*heard(0, State.SLEEPING, 0.9), {"deviation": below(0.02)}),
            (
                None,
                5 * HOUR,
                {
                    "primary": pytest.approx(0.9 - 60 * (3 * ASLEEP + 2 * IDLE), abs=0.015),
                    "deviation": above(0.03),
                    "mode": Mode.IDLE,
                    Mode.IDLE: pytest.approx(0.97),
                    "heard_ms": 0,
                    "at_ms": 5 * HOUR,
                    "narrow": (pytest.approx(0.97**5, abs=0.01), True),
                },
            ),
        ],
    ),
    "one that did not obey is known when it is heard": (
        {},
        ALWAYS_ASLEEP,
        [
            *unread(heard(0, State.SLEEPING, 0.5), (Permitted(), HOUR)),
            (
                *heard(5 * HOUR, State.SLEEPING, 0.5 - 300 * ASLEEP, 5),
                {
                    "mode": Mode.ASLEEP,
                    "primary": pytest.approx(0.5 - 300 * ASLEEP, abs=0.01),
                    "deviation": below(0.1),
                    "gated": 0,
                },
            ),
        ],
    ),
    # A sag of 0.01: the battery holds 0.49, so 0.017 of a run of 0.027 is left; the filter knows a part of that.
    "motors that run are heard while one surfaces": (
        {},
        ALWAYS_ASLEEP,
        [
            *unread(heard(0, State.SLEEPING, 0.5), (Permitted(), 1000)),
            (
                *heard(20_000, State.SURFACING, 0.48, 1),
                {
                    "mode": Mode.SURFACING,
                    "primary": pytest.approx(0.473, abs=0.008),
                    "deviation": between(0.004, 0.02),
                    "gated": 0,
                },
            ),
        ],
    ),
    # The charger lifts the voltage by 0.03.
    "docked by somebody else it is believed as heard": (
        {},
        ALWAYS_ASLEEP,
        [
            *unread(heard(0, State.SLEEPING, 0.5)),
            (
                *heard(6 * HOUR, State.CHARGING, 0.93, 6),
                {
                    "mode": Mode.CHARGING_PRIMARY,
                    "primary": pytest.approx(0.9, abs=0.02),
                    "deviation": below(0.1),
                    "gated": 0,
                },
            ),
        ],
    ),
    # One of six hours under high load, not observed.
    "what was not scheduled is found out by the next packet": (
        {},
        ALWAYS_ASLEEP,
        [
            *NIGHT,
            (
                *heard(8 * HOUR, State.SLEEPING, 0.87 - 60 * (5 * ASLEEP + HIGH), 8),
                {
                    "mode": Mode.ASLEEP,
                    "primary": pytest.approx(0.87 - 60 * (5 * ASLEEP + HIGH), abs=0.02),
                    "deviation": below(0.1),
                    "gated": 0,
                },
            ),
        ],
    ),
    "a packet in time corrects one filter and the mode is known": (
        {},
        ALWAYS_ASLEEP,
        [
            *unread(*hourly(State.SLEEPING, 0.9, 60 * ASLEEP, 5)),
            (
                *heard(5 * HOUR, State.ACTIVE, 0.87, 5),
                {
                    "mode": Mode.IDLE,
                    Mode.IDLE: 1.0,
                    "filters": (1, 1),
                    "heard_ms": 5 * HOUR,
                    "silent_timeslots": 0,
                    "learned_from": Source.PACKET,
                },
            ),
        ],
    ),
    "a gross outlier is gated, and one that agrees with those before it is believed": (
        {},
        ALWAYS_ASLEEP,
        [
            *ODD,
            (
                *heard(7 * HOUR, State.SLEEPING, 0.9 - 7 * 60 * ASLEEP, 7),
                {"primary": pytest.approx(0.87, abs=0.02)},
            ),
        ],
    ),
    "a gross outlier is gated until another agrees with it": (
        {},
        ALWAYS_ASLEEP,
        [
            *ODD,
            (
                *heard(7 * HOUR, State.SLEEPING, 0.2 - 60 * ASLEEP, 7),
                {"primary": pytest.approx(0.195, abs=0.03)},
            ),
        ],
    ),
    "charges stay possible": (
        {},
        {},
        [
            *unread(heard(0, State.ACTIVE, 0.3)),
            *looks(range(1, 99), POSSIBLE),
            (None, 99 * HOUR, {**POSSIBLE, "primary": between(0, 0.02)}),
            (Docked(), 100 * HOUR, {}),
            *looks(range(101, 129), {"primary": between(0, 1)}),
            (None, 129 * HOUR, {"primary": between(0.99, 1), "mode": Mode.FULL}),
        ],
    ),
    # 0.3 of a battery at the asleep rate lasts 71 h beyond the three and a half of the primary.
    "with its primary empty it sleeps on the secondary until it is lost": (
        {},
        {1: Schedule((0,), (Mode.IDLE,))},
        [
            *unread(heard(0, State.ACTIVE, 0.2, secondary=0.3)),
            (None, 12 * HOUR, {"empty": above(0.9), "mode": Mode.ASLEEP, Mode.LOST: below(0.01)}),
            (None, 50 * HOUR, {"secondary": pytest.approx(0.3 - 46.6 * 60 * ASLEEP, abs=0.03)}),
            (None, 129 * HOUR, {Mode.LOST: above(0.9)}),
        ],
    ),
    # It hears the permission within two seconds, and with 90 %: until then no motor has run.
    "what the aPad did is known without a packet": (
        {},
        ALWAYS_ASLEEP,
        [
            *unread(heard(0, State.SLEEPING, 0.5)),
            (
                Permitted(),
                HOUR,
                {"mode": Mode.SURFACING, "primary": pytest.approx(0.5 - 60 * ASLEEP, abs=1e-3)},
            ),
            (None, HOUR + 2000, {"primary": pytest.approx(0.5 - 60 * ASLEEP - 0.9 * 0.027, abs=0.001)}),
            (Permitted(), HOUR + 1000, {}),
            (None, HOUR + 2000, {"primary": pytest.approx(0.5 - 60 * ASLEEP - 0.9 * 0.027, abs=0.001)}),
            (
                Docked(),
                HOUR + 600_000,
                {"mode": Mode.CHARGING_PRIMARY, "learned_from": Source.PACKET | Source.DOCKING},
            ),
            (None, 8 * HOUR, {"primary": above(0.98), "heard_ms": 0}),
            (
                Released(20.0, 30.0),
                8 * HOUR,
                {
                    "mode": Mode.ASLEEP,
                    "place": (20.0, 30.0),
                    "primary": pytest.approx(1 - 0.027 - IDLE, abs=0.01),
                },
            ),
        ],
    ),
    # Bayes: 0.09 / (0.09 + 0.1) when the first call is due and not received, 0.009 / (0.009 + 0.1) after the second.
    # After a second permission its motors have run at most once: for the first as probably as before, or for none.
    "silence from the surface says that it stayed below": (
        {"calls": CallParameters(30_000, 0.1)},
        ALWAYS_ASLEEP,
        [
            *unread(heard(0, State.SLEEPING, 0.5), (Permitted(), HOUR)),
            (None, HOUR + 59_000, {Mode.SURFACING: pytest.approx(0.9)}),
            (None, HOUR + 60_000, {Mode.FLOATING: pytest.approx(0.4737, abs=1e-4)}),
            (None, HOUR + 91_000, {Mode.FLOATING: pytest.approx(0.0826, abs=1e-4), "mode": Mode.ASLEEP}),
            (
                Permitted(),
                HOUR + 91_000,
                {
                    Mode.SURFACING: pytest.approx(0.9),
                    "primary": pytest.approx(
                        (1 - 0.0826) * (0.5 - 61.5 * ASLEEP) + 0.0826 * FLOATS, abs=3e-4
                    ),
                },
            ),
            *unread(heard(HOUR + 160_000, State.FLOATING, 0.46, 1)),
            (None, HOUR + 900_000, {Mode.FLOATING: pytest.approx(1.0)}),
        ],
    ),
    # Its sensor reads 0.033 too high, and it is not full: nobody knows that it rests at an end.
    "a first reading near full says nothing of the sensor": (
        UNTOLD,
        ALWAYS_ASLEEP,
        [
            *unread(*(heard(n * 600_000, State.SLEEPING, 0.97 - 10 * n * ASLEEP, n) for n in range(12))),
            (
                None,
                110 * 60_000,
                {
                    "low": below(0.97 - 0.033 - 110 * ASLEEP),
                    "high": above(0.97 - 0.033 - 110 * ASLEEP),
                    "primary": pytest.approx(0.97 - 110 * ASLEEP, abs=0.02),
                },
            ),
        ],
    ),
    # One call is missing: 0.09 / (0.09 + 0.1) that it floats.
    "while it may have obeyed or not both charges are believed": (
        CALLS_300,
        ALWAYS_ASLEEP,
        [
            *CALLED,
            (
                None,
                HOUR + 300_000,
                {
                    Mode.FLOATING: pytest.approx(0.4737, abs=1e-3),
                    "primary": pytest.approx(
                        0.6 - 60 * ASLEEP - 0.4737 * (0.027 + 0.003 * 4) - 0.5263 * 5 * ASLEEP, abs=0.003
                    ),
                    "low": below(0.6 - 60 * ASLEEP - 0.027 - 0.003 * 4),
                    "high": above(0.6 - 65 * ASLEEP),
                },
            ),
        ],
    ),
    # Its Wi-Fi was off in the dock, so it waits the whole two minutes.
    "a released one may wait before its motors run": (
        WAITS,
        ALWAYS_ASLEEP,
        [
            *IN_DOCK,
            (
                Released(0.0, 0.0),
                12 * HOUR,
                {"mode": Mode.FLOATING, "primary": pytest.approx(1.0, abs=1e-3)},
            ),
            *(
                (
                    None,
                    12 * HOUR + 1000 * seconds,
                    {"low": below(1 - 0.027 - IDLE - 0.001), "high": above(0.999)},
                )
                for seconds in (10, 60, 120, 170)
            ),
            (
                None,
                12 * HOUR + 240_000,
                {
                    "mode": Mode.ASLEEP,
                    "primary": pytest.approx(1 - 0.027 - IDLE - 0.001 - 0.004 - 4 * ASLEEP, abs=3e-4),
                },
            ),
        ],
    ),
    "a released one that is heard while it waits, and told, sinks at once": (
        WAITS,
        ALWAYS_ASLEEP,
        [
            *IN_DOCK,
            *unread((Released(0.0, 0.0), 12 * HOUR)),
            (
                *heard(12 * HOUR + 60_000, State.RELEASED, 0.998, 1),
                {"primary": pytest.approx(0.9975, abs=5e-4)},
            ),
            (
                None,
                12 * HOUR + 300_000,
                {
                    "mode": Mode.ASLEEP,
                    "primary": pytest.approx(0.9975 - 0.027 - IDLE - 0.001 - 3 * ASLEEP, abs=4e-4),
                },
            ),
        ],
    ),
    # The alarm of a board that waits, sinks or listens wakes nobody: the next wake is an hour later.
    "one that is released at the full hour misses that wake": (
        {
            "board": listening(release_wait_ms=120_000),
            "habits": replace(KNOWLEDGE.habits, unscheduled=0.0),
        },
        {1: Schedule((0,), (Mode.ASLEEP,), CycleParameters.of([(60_000, 0.01), (HOUR, ASLEEP)], HOUR))},
        [
            *IN_DOCK,
            *unread((Released(0.0, 0.0), 12 * HOUR)),
            (None, 13 * HOUR - 1000, {"primary": pytest.approx(1 - 0.027 - IDLE - 60 * ASLEEP, abs=3e-4)}),
            (
                None,
                13 * HOUR + 600_000,
                {"primary": pytest.approx(1 - 0.027 - IDLE - 69 * ASLEEP - 0.01, abs=3e-4)},
            ),
        ],
    ),
    # Its motors run after a packet with RELEASED: a reading from before, 1.0 that sags by 0.03, is no evidence of a bias.
    # By the packet with SINKING about half of the run is over, and the rest is still to come.
    "one that waits to sink is not taken for one that has sunk": (
        {},
        ALWAYS_ASLEEP,
        [
            *IN_DOCK,
            (Released(0.0, 0.0), HOUR, {"primary": pytest.approx(1 - 0.027 - IDLE, abs=1e-6)}),
            (
                *heard(HOUR + 30_000, State.RELEASED, 0.97, 1),
                {
                    "primary": pytest.approx(1 - 0.027 - IDLE, abs=0.003),
                    "learned": pytest.approx([1, 0, -0.01, -0.03], abs=0.002),
                },
            ),
            (
                *heard(HOUR + 60_000, State.SINKING, 1 - 0.027 - IDLE * 1.5 + 0.0135, 2),
                {
                    "primary": pytest.approx(1 - 0.027 - IDLE * 1.5, abs=0.012),
                    "deviation": between(0.004, 1),
                },
            ),
            (
                *heard(3 * HOUR, State.SLEEPING, 1 - 0.027 - IDLE * 1.5 - 120 * ASLEEP, 3),
                {"primary": pytest.approx(1 - 0.027 - IDLE * 1.5 - 120 * ASLEEP, abs=0.006)},
            ),
        ],
    ),
    "readings at the end of the scale do not pull a full battery down": (
        {},
        ALWAYS_ASLEEP,
        [
            *unread(*(heard(n * 600_000, State.CHARGING, it, n) for n, it in enumerate(AT_THE_END.tolist()))),
            (None, 299 * 600_000, {"primary": above(0.999), "lift": pytest.approx(0.0, abs=0.004)}),
        ],
    ),
    "a clock that gains is learned": (
        {},
        {},
        [
            *unread(
                *(
                    heard(n * HOUR, State.SLEEPING, 0.9, n, agent_ms=n * HOUR + it)
                    for n, it in enumerate(AHEAD_MS)
                )
            ),
            (
                None,
                199 * HOUR,
                {"clock": (pytest.approx(30, abs=3), pytest.approx(AHEAD_MS[-1], abs=500))},
            ),
        ],
    ),
    **{
        f"the water moves it in mission time, here at theta {theta}": (
            {"scale": TimeScale(theta)},
            {},
            [
                *unread(heard(0, State.ACTIVE, 0.9, agent_ms=0)),
                (None, HOUR, {"place_variance": pytest.approx(1.0 + 3600 * 0.001, abs=0.036)}),
            ],
        )
        for theta in (1, 30)
    },
    "a range says how far and not where": (
        {"water": WaterParameters(0.01, 0.0, 3600.0, 1.0)},
        {},
        [
            *unread(heard(0, State.ACTIVE, 0.9)),
            (None, 10 * HOUR, {"place_cov": pytest.approx((361.0, 0.0, 361.0))}),
            (
                Ranged(110.0, 3.0, -96.0, 0.25),
                10 * HOUR,
                {
                    "place": (pytest.approx(3.0, abs=0.1), pytest.approx(14.0, abs=3.0)),
                    "place_variance": pytest.approx(361.0, rel=0.01),
                    "east_variance": between(0, 361 / 5),
                    "learned_from": Source.PACKET | Source.RANGE,
                },
            ),
            (Fixed(5.0, 12.0, 1.0), 10 * HOUR, {"place_variance": between(0, 1)}),
        ],
    ),
    **{
        f"one that is asked within a wake: {state.name} is {mode.name} by {len(schedules)} schedules": (
            {},
            schedules,
            [
                *unread(*hourly(State.SLEEPING, 0.9, 60 * ASLEEP, 5)),
                (ShortStatus(1, state, 0.883, 1.0), 4 * HOUR + 600_000, {"mode": mode, "state": state}),
            ],
        )
        for schedules, state, mode in (
            (ALWAYS_ASLEEP, State.PROCESSING, Mode.ASLEEP),
            (ALWAYS_ASLEEP, State.ACTIVE, Mode.ASLEEP),
            (ALWAYS_ASLEEP, State.HOVERING, Mode.HIGH_LOAD),
            ({}, State.PROCESSING, Mode.HIGH_LOAD),
        )
    },
    **{
        f"how sure a place is: {name}": (
            {"water": water},
            ALWAYS_ASLEEP,
            [
                *steps[:-1],
                (*steps[-1][:2], {"place_variance": between(least * (1 - 1e-6), most * (1 + 1e-6))}),
            ],
        )
        for name, (water, steps, least, most) in HOW_SURE.items()
    },
    "a fix as it left the surface which no packet had stated is weighed": (
        {"water": GPS},
        ALWAYS_ASLEEP,
        [
            *AFLOAT,
            (*placed(120_000, 5, State.SLEEPING, 3.0, north_m=3.4), {"north_m": between(3.0001, 3.3999)}),
        ],
    ),
    # An empty or full secondary that reads 0.5 has a bias of a half, which no board has.
    **{
        f"the first reading of the secondary, {stated}, is believed within the greatest bias": (
            UNTOLD,
            ALWAYS_ASLEEP,
            [
                (
                    *heard(HOUR, State.SLEEPING, 0.6, secondary=stated),
                    {
                        "secondary": pytest.approx(stated, abs=0.05),
                        "secondary_variance": between(0, 0.05**2),
                    },
                )
            ],
        )
        for stated in (0.04, 0.5, 0.96)
    },
}


@pytest.mark.parametrize(("knows", "schedules", "steps"), SCENES.values(), ids=SCENES)
def test_scene(knows: dict[str, Any], schedules: dict[int, Schedule], steps: Steps) -> None:
    twin, belief = Twin(replace(KNOWLEDGE, **knows), schedules), None
    for measurement, at_ms, wanted in steps:
        if measurement is None:
            seen = twin.predict(belief, at_ms)
        else:
            belief = seen = twin.update(belief, measurement, at_ms)
        found = {it: FIGURES[it](seen) if it in FIGURES else getattr(seen, it) for it in wanted}
        assert found == wanted, at_ms


def test_asking_often_changes_nothing(untaught: Twin) -> None:
    belief = asked = told(untaught, heard(0, State.ACTIVE, 0.9))
    for at_ms in range(0, 30 * HOUR, 777_777):
        asked = untaught.predict(asked, at_ms)
    once, often = (
        [later.primary, *later.charge_cov, *later.mode_probabilities]
        for later in (untaught.predict(belief, 30 * HOUR), untaught.predict(asked, 30 * HOUR))
    )
    assert often == pytest.approx(once, abs=1e-3)


def test_a_state_that_moves_in_time_and_a_belief_that_counts_silence_keep_every_other_field() -> None:
    """Both are written out, for speed: a field that is forgotten there would fall back to its default."""
    twin_state = TwinState(*(object() for _ in fields(TwinState)))  # type: ignore[arg-type]
    load, unobeyed = Load.known(Mode.IDLE), (Load.known(Mode.ASLEEP), 5)
    moved = replace(twin_state, at_ms=7, load=load, unobeyed=unobeyed)
    assert values(twin_state.moved_to(7, load, unobeyed)) == values(moved)
    belief = replace(
        Belief(*(object() for _ in fields(Belief))),  # type: ignore[arg-type]
        learned_from=Source.DOCKING,
    )
    silent = replace(belief, silent_timeslots=3, learned_from=Source.DOCKING | Source.SILENCE)
    assert values(belief.counting_silence(3)) == values(silent)


def values(one: TwinState | Belief) -> list[object]:
    return [getattr(one, it.name) for it in fields(one)]


def test_a_silent_slot_moves_the_modes_probabilities(untaught: Twin) -> None:
    """filterpy's estimator leaves them unchanged on a prediction, and scores silence as a perfect reading."""
    reports = [
        heard(0, State.PROCESSING, 0.9),
        *((TimeslotSilent(), hour * HOUR + 1) for hour in range(1, 12)),
    ]
    beliefs = [told(untaught, *reports[: n + 1]) for n in range(12)]
    shares = [it.probability_of(Mode.HIGH_LOAD) for it in beliefs]
    assert shares[0] == 1.0 and shares == sorted(shares, reverse=True)
    last = beliefs[-1]
    assert (last.mode, last.silent_timeslots) == (Mode.ASLEEP, 11) and Source.SILENCE in last.learned_from
    assert sum(last.mode_probabilities) == pytest.approx(1.0)


def test_one_that_is_up_too_early_for_a_repeated_permission_obeyed_the_first() -> None:
    """The aPad was too far off to hear it, and repeated: it has floated for five minutes more than the second explains."""
    twin = Twin(replace(KNOWLEDGE, calls=CallParameters(300_000, 0.1)), ALWAYS_ASLEEP)
    first = heard(0, State.SLEEPING, 0.6), (Permitted(), HOUR)
    both = told(twin, *first, (Permitted(), HOUR + 400_000))
    floats = 0.6 - 60 * ASLEEP - 0.027 - IDLE - 0.003 * 6
    early, late_ms = heard(HOUR + 430_000, State.FLOATING, floats, 1), HOUR + 600_000
    assert twin.update(both, *early).primary == pytest.approx(told(twin, *first, early).primary, abs=1e-6)
    # Later, and unheard, it may have obeyed either.
    low, high = twin.predict(both, late_ms).charge_interval()
    assert low < floats - 0.003 * 2.8 and high > 0.6 - 70 * ASLEEP - 0.027 - IDLE - 0.003 * 2.3
    # A reading decides, and a copy from its plain data goes on alike.
    copy = twin.restored(1, json.loads(json.dumps(twin.kept(both))))
    assert twin.predict(copy, late_ms) == twin.predict(both, late_ms)


def test_one_that_should_have_sunk_again_obeyed_as_probably_as_it_hears() -> None:
    """A reading midway says nothing of it: nine in ten hear a permission. It floated for five minutes or not at all."""
    knows = {"habits": replace(KNOWLEDGE.habits, unscheduled=0.0)}
    knows |= {"board": replace(KNOWLEDGE.board, float_timeout_ms=300_000)}
    unsure, sure = (
        Twin(replace(KNOWLEDGE, permission_arrives=it, **knows), ALWAYS_ASLEEP) for it in (0.9, 1.0)
    )
    asleep, permission = heard(0, State.SLEEPING, 0.6), (Permitted(), HOUR)
    told_of = told(sure, asleep, permission), told(sure, asleep)
    midway = heard(2 * HOUR, State.SLEEPING, sum(sure.predict(it, 2 * HOUR).primary for it in told_of) / 2, 1)
    obeyed, stayed = (sure.update(it, *midway).primary for it in told_of)
    found = told(unsure, asleep, permission, midway).primary
    assert found == pytest.approx(0.9 * obeyed + 0.1 * stayed, abs=5e-4) and stayed - obeyed > 0.03


def test_one_that_never_heard_its_permission_keeps_its_charge() -> None:
    """It sleeps on the bottom, unheard for days: what floating would have cost is not taken from it."""
    twin, without_calls = (Twin(replace(KNOWLEDGE, **it), ALWAYS_ASLEEP) for it in (CALLS_300, {}))
    asleep, permission = heard(0, State.SLEEPING, 0.6), (Permitted(), HOUR)
    for hours in (2, 12, 14, 30, 47, 60, 90):
        later, unasked = (twin.predict(told(twin, asleep, *it), hours * HOUR) for it in ([permission], []))
        truth = 0.6 - 60 * hours * ASLEEP
        low, high = later.charge_interval()
        assert low <= truth <= high and later.mode is Mode.ASLEEP, hours
        # Silence from the surface is evidence, so the charge is known about as well as without a permission.
        assert later.primary == pytest.approx(unasked.primary, abs=0.005)
        # Without evidence one in ten did not hear it, and hardly any of them draws more than scheduled in a day.
        unsure = without_calls.predict(told(without_calls, asleep, permission), hours * HOUR)
        assert hours > 30 or unsure.probability_at_most(truth - 0.03) < 0.96, hours


@pytest.mark.parametrize(
    ("state", "mode", "costs"),
    [(State.ACTIVE, Mode.IDLE, (IDLE - ASLEEP) / 2), (State.PROCESSING, Mode.ASLEEP, 0.0)],
)
def test_a_sleeper_that_is_awake_for_a_moment_is_not_taken_for_awake_until_the_hour(
    state: State, mode: Mode, costs: float
) -> None:
    """A board that came to rest, or booted, listens for a minute and then sleeps; a wake is as short."""
    cycle = CycleParameters.of([(60_000, 0.002), (HOUR, ASLEEP)], HOUR)
    drain = replace(KNOWLEDGE.drain, listening=IDLE - ASLEEP)
    twin = Twin(
        replace(KNOWLEDGE, drain=drain, board=listening()), {1: Schedule((0,), (Mode.ASLEEP,), cycle)}
    )
    at_ms, before = 5 * HOUR + 120_000, heard(4 * HOUR + 120_000, State.SLEEPING, 0.9)
    awake, asleep = (
        told(twin, before, heard(at_ms, it, 0.9 - 60 * ASLEEP, 1)) for it in (state, State.SLEEPING)
    )
    later, slept = (twin.predict(it, at_ms + 50 * 60_000) for it in (awake, asleep))
    assert (awake.mode, later.probability_of(Mode.ASLEEP)) == (mode, pytest.approx(1.0))
    assert slept.primary - later.primary == pytest.approx(costs, abs=2e-4)


def test_how_fast_one_charges_is_learned_in_its_dock() -> None:
    """Its batteries hold a sixth less: it charges 20 % faster than the kind, and in its next docking that is known."""
    twin = Twin(
        replace(KNOWLEDGE, charger=replace(KNOWLEDGE.charger, deviation=0.02, rate_deviation=0.1)),
        ALWAYS_ASLEEP,
    )
    slow, fast = (KNOWLEDGE.charger.primary * rate * 0.00223 - 0.6 * ASLEEP for rate in (1.0, 1.2))
    readings = [heard(n * 600_000, State.CHARGING, 0.2 + 10 * n * fast + 0.03, n) for n in range(1, 13)]
    belief = told(twin, heard(0, State.FLOATING, 0.2), (Docked(), 1000), *readings)
    gained = twin.predict(belief, 13 * 600_000).primary - belief.primary
    assert gained > 10 * (0.5 * slow + 0.5 * fast)


def test_drain_and_bias_of_one_are_learned_while_it_is_heard(untaught: Twin) -> None:
    rng, charge, reports = np.random.default_rng(2), 0.95, []
    drain, sag = 1.08, -0.022
    for hour in range(60):
        state, off, load = (State.SLEEPING, 0.0, ASLEEP) if hour % 8 else (State.ACTIVE, sag, IDLE)
        reports.append(heard(hour * HOUR, state, min(1.0, charge + off + rng.normal(0, 0.015)), hour))
        charge -= drain * 60 * load
    twin_state = state_of(told(untaught, *reports))
    learned, spread = twin_state.mean, np.sqrt(np.diag(twin_state.cov))
    assert learned[2] == pytest.approx(drain, abs=0.03) and spread[2] < 0.03
    assert learned[4] == pytest.approx(sag, abs=3 * spread[4]) and spread[4] < 0.005


def test_readings_near_to_each_other_are_one_and_change_nothing_else(untaught: Twin) -> None:
    """200 independent readings would leave one hundredth of the variance."""
    first, *others = (heard(1000 * n, State.ACTIVE, 0.9 - n * IDLE / 60, n) for n in range(200))
    belief = told(untaught, first, *others)
    assert belief.heard_ms == 199_000 and belief.charge_cov[0] > told(untaught, first).charge_cov[0] / 2.5
    assert untaught.update(belief, *heard(200_000, State.PROCESSING, 0.87, 200)).mode is Mode.HIGH_LOAD


def test_a_short_status_corrects_the_charge_and_says_nothing_of_place_or_time(twin: Twin) -> None:
    drained = 60 * ASLEEP
    before = told(twin, *hourly(State.SLEEPING, 0.9, drained, 5))
    far = twin.predict(before, 30 * HOUR)
    short = twin.update(before, ShortStatus(1, State.SLEEPING, 0.9 - 30 * drained - 0.02, 1.0), 30 * HOUR)
    assert (short.heard_ms, short.silent_timeslots, short.learned_from) == (30 * HOUR, 0, Source.PACKET)
    assert short.charge_cov[0] < far.charge_cov[0] / 50
    assert short.primary == pytest.approx(0.754, abs=2 * KNOWLEDGE.sensor.noise)
    assert (short.north_m, short.east_m, short.place_cov) == (far.north_m, far.east_m, far.place_cov)
    assert short.clock == far.clock and state_of(short).packet == state_of(before).packet
    # A delayed full status with an earlier stamp is still believed, because it states its own time.
    later = twin.update(short, *heard(30 * HOUR, State.SLEEPING, 0.86, 30, agent_ms=30 * HOUR - 5000))
    assert state_of(later).packet == (30, 30 * HOUR - 5000)


@pytest.mark.parametrize(("deviations", "gated"), [(-4.0, 0), (4.0, 0), (-7.0, 1)])
def test_the_gate_stands_between_four_deviations_and_seven(twin: Twin, deviations: float, gated: int) -> None:
    due = twin.predict(told(twin, *hourly(State.SLEEPING, 0.7, 60 * ASLEEP, 6)), 6 * HOUR)
    # The error of a reading asleep: charge, noise and bias, of which the last two are 0.015 and at most 0.004.
    sd = (state_of(due).cov[0, 0] + 0.015**2) ** 0.5
    odd = twin.update(due, *heard(6 * HOUR, State.SLEEPING, due.primary + deviations * sd, 6))
    assert state_of(odd).gated == gated


@pytest.mark.parametrize("placed", [True, False])
def test_a_belief_outlives_a_hand_over_and_the_next_board_is_believed_from_its_first_packet(
    twin: Twin, placed: bool
) -> None:
    before = told(twin, *hourly(State.SLEEPING, 0.7, 60 * ASLEEP, 6))
    after = told(twin, *hourly(State.SLEEPING, 0.7, 60 * ASLEEP, 6), (HandedOver(placed), 5 * HOUR))
    # A charge of which nothing is known is uniform: its deviation is 1 / sqrt(12), and 0.3 clamped to [0, 1] is near it.
    deviation = sqrt(before.charge_cov[0]) if placed else sqrt(1 / 12)
    assert sqrt(after.charge_cov[0]) == pytest.approx(deviation, abs=1e-3 if placed else 0.05)
    assert abs(after.primary - before.primary) < (1e-3 if placed else 0.05)
    assert (after.north_m, after.east_m) == (before.north_m, before.east_m)
    assert after.place_cov == (before.place_cov if placed else (100.0**2, 0.0, 100.0**2))
    assert after.is_of_another_board is not placed
    assert twin.restored(1, json.loads(json.dumps(twin.kept(after)))) == after
    later = twin.predict(after, 6 * HOUR)
    assert later.charge_cov[0] >= after.charge_cov[0] and later.is_of_another_board is not placed
    # Its clock is minutes old, its charge and place are others: all as of a board that is heard for the first time.
    new = heard(6 * HOUR, State.SLEEPING, 0.3, agent_ms=60_000)
    first, alone = twin.update(later, *new), told(twin, new)
    assert first == alone and not first.is_of_another_board
    again = heard(7 * HOUR, State.SLEEPING, 0.296, sequence=1, agent_ms=60_000 + HOUR)
    assert twin.update(first, *again) == twin.update(alone, *again)
