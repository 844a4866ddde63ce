from __future__ import annotations

import json
from dataclasses import fields, replace
from math import sqrt

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


def test_it_goes_on_by_the_schedule_and_says_how_sure_it_is() -> None:
    twin = Twin(KNOWLEDGE, {1: Schedule((0, 3 * HOUR), (Mode.ASLEEP, Mode.IDLE))})
    belief = told(twin, heard(0, State.SLEEPING, 0.9))
    later = twin.predict(belief, 5 * HOUR)
    scheduled = 0.9 - 60 * (3 * ASLEEP + 2 * IDLE)
    assert later.primary == pytest.approx(scheduled, abs=0.015)
    assert later.mode is Mode.IDLE and later.probability_of(Mode.IDLE) == pytest.approx(0.97)
    assert (later.heard_ms, later.at_ms, later.age_s(5 * HOUR)) == (0, 5 * HOUR, 18_000)
    assert later.charge_cov[0] > belief.charge_cov[0]
    # Most of the weight is one narrow Gaussian; a tail holds the unscheduled modes.
    assert later.parts[0].weight == pytest.approx(0.97**5, abs=0.01) and len(later.parts) > 1
    with pytest.raises(ValueError, match="time went back"):
        twin.predict(later, HOUR)


def test_asking_often_changes_nothing(untaught: Twin) -> None:
    belief = told(untaught, heard(0, State.ACTIVE, 0.9))
    asked = belief
    for at_ms in range(0, 30 * HOUR, 777_777):
        asked = untaught.predict(asked, at_ms)
    once, often = untaught.predict(belief, 30 * HOUR), untaught.predict(asked, 30 * HOUR)
    assert often.primary == pytest.approx(once.primary, abs=1e-3)
    assert often.charge_cov == pytest.approx(once.charge_cov, abs=1e-3)
    assert often.mode_probabilities == pytest.approx(once.mode_probabilities, abs=1e-3)


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
    belief = told(untaught, heard(0, State.PROCESSING, 0.9))
    shares = [belief.probability_of(Mode.HIGH_LOAD)]
    for hour in range(1, 12):
        belief = untaught.update(belief, TimeslotSilent(), hour * HOUR + 1) or belief
        shares.append(belief.probability_of(Mode.HIGH_LOAD))
    assert shares[0] == 1.0 and shares == sorted(shares, reverse=True)
    assert belief.mode is Mode.ASLEEP and sum(belief.mode_probabilities) == pytest.approx(1.0)
    assert belief.silent_timeslots == 11 and Source.SILENCE in belief.learned_from


@pytest.fixture
def twin() -> Twin:
    return Twin(KNOWLEDGE, ALWAYS_ASLEEP)


NIGHT = hourly(State.SLEEPING, 0.9, 60 * ASLEEP, 3)


@pytest.mark.parametrize(
    ("measurements", "mode", "primary", "within", "deviation"),
    [
        pytest.param(
            [
                heard(0, State.SLEEPING, 0.5),
                (Permitted(), HOUR),
                heard(5 * HOUR, State.SLEEPING, 0.5 - 300 * ASLEEP, 5),
            ],
            Mode.ASLEEP,
            0.5 - 300 * ASLEEP,
            0.01,
            (0.0, 0.1),
            id="one that did not obey is known when it is heard",
        ),
        # A sag of 0.01: the battery holds 0.49, so 0.017 of a run of 0.027 is left; the filter knows a part of that.
        pytest.param(
            [heard(0, State.SLEEPING, 0.5), (Permitted(), 1000), heard(20_000, State.SURFACING, 0.48, 1)],
            Mode.SURFACING,
            0.473,
            0.008,
            (0.004, 0.02),
            id="motors that run are heard while one surfaces",
        ),
        # The charger lifts the voltage by 0.03.
        pytest.param(
            [heard(0, State.SLEEPING, 0.5), heard(6 * HOUR, State.CHARGING, 0.93, 6)],
            Mode.CHARGING_PRIMARY,
            0.9,
            0.02,
            (0.0, 0.1),
            id="docked by somebody else it is believed as heard",
        ),
        # One of six hours under high load, not observed.
        pytest.param(
            [*NIGHT, heard(8 * HOUR, State.SLEEPING, 0.87 - 60 * (5 * ASLEEP + HIGH), 8)],
            Mode.ASLEEP,
            0.87 - 60 * (5 * ASLEEP + HIGH),
            0.02,
            (0.0, 0.1),
            id="what was not scheduled is found out by the next packet",
        ),
    ],
)
def test_a_packet_decides(
    twin: Twin,
    measurements: list[_Stamped],
    mode: Mode,
    primary: float,
    within: float,
    deviation: tuple[float, float],
) -> None:
    belief = told(twin, *measurements)
    assert (belief.mode, belief.primary) == (mode, pytest.approx(primary, abs=within))
    assert deviation[0] ** 2 < belief.charge_cov[0] < deviation[1] ** 2 and state_of(belief).gated == 0


def test_a_packet_in_time_corrects_one_filter_and_the_mode_is_known(twin: Twin) -> None:
    belief = told(twin, *hourly(State.SLEEPING, 0.9, 60 * ASLEEP, 5), heard(5 * HOUR, State.ACTIVE, 0.87, 5))
    assert belief.mode is Mode.IDLE and belief.probability_of(Mode.IDLE) == 1.0
    assert len(belief.parts) == 1 and len(state_of(belief).anchors) == 1
    assert (belief.heard_ms, belief.silent_timeslots, belief.learned_from) == (5 * HOUR, 0, Source.PACKET)


def test_a_gross_outlier_is_gated_until_another_agrees(twin: Twin) -> None:
    steady = told(twin, *hourly(State.SLEEPING, 0.9, 60 * ASLEEP, 6))
    odd = twin.update(steady, *heard(6 * HOUR, State.SLEEPING, 0.2, 6))
    assert odd is not None and odd.primary > 0.7 and state_of(odd).gated == 1
    assert odd.charge_cov[0] > 100 * steady.charge_cov[0]
    back = twin.update(odd, *heard(7 * HOUR, State.SLEEPING, 0.9 - 7 * 60 * ASLEEP, 7))
    assert back is not None and back.primary == pytest.approx(0.87, abs=0.02)
    low = twin.update(odd, *heard(7 * HOUR, State.SLEEPING, 0.2 - 60 * ASLEEP, 7))
    assert low is not None and low.primary == pytest.approx(0.195, abs=0.03)


def test_duplicates_and_late_packets_are_not_believed(untaught: Twin) -> None:
    belief = told(untaught, heard(HOUR, State.ACTIVE, 0.8, 5))
    with pytest.raises(Rejected, match="already"):
        untaught.update(belief, *heard(HOUR + 500, State.ACTIVE, 0.8, 5, agent_ms=HOUR))
    with pytest.raises(Rejected, match="overtook"):
        untaught.update(belief, *heard(HOUR + 500, State.ACTIVE, 0.85, 4, agent_ms=HOUR - 10_000))


def test_charges_stay_possible(untaught: Twin) -> None:
    belief = told(untaught, heard(0, State.ACTIVE, 0.3))
    for hour in range(1, 100):
        belief = untaught.predict(belief, hour * HOUR)
        assert 0 <= belief.primary <= 1 and 0 <= belief.secondary <= 1
        assert 0 <= belief.charge_cov[0] <= 0.26
    assert belief.primary < 0.02
    docked = untaught.update(belief, Docked(), 100 * HOUR)
    for hour in range(101, 130):
        docked = untaught.predict(docked, hour * HOUR)
        assert 0 <= docked.primary <= 1
    assert docked.primary > 0.99 and docked.mode is Mode.FULL


def test_with_its_primary_empty_it_sleeps_on_the_secondary_until_it_is_lost() -> None:
    twin = Twin(KNOWLEDGE, {1: Schedule((0,), (Mode.IDLE,))})
    belief = told(twin, heard(0, State.ACTIVE, 0.2, secondary=0.3))
    empty = twin.predict(belief, 12 * HOUR)
    assert empty.probability_at_most(0.0) > 0.9 and empty.mode is Mode.ASLEEP
    assert empty.probability_of(Mode.LOST) < 0.01
    # 0.3 of a battery at the asleep rate lasts 71 h beyond the three and a half of the primary.
    for hour in range(13, 130):
        belief = empty = twin.predict(empty, hour * HOUR)
        if hour == 50:
            assert empty.secondary == pytest.approx(0.3 - 46.6 * 60 * ASLEEP, abs=0.03)
    assert belief.probability_of(Mode.LOST) > 0.9


def test_what_the_apad_did_is_known_without_a_packet(twin: Twin) -> None:
    belief = told(twin, heard(0, State.SLEEPING, 0.5, secondary=1.0))
    up = twin.update(belief, Permitted(), HOUR)
    assert up is not None and up.mode is Mode.SURFACING
    # It hears the permission within two seconds, and with 90 %: until then no motor has run.
    assert up.primary == pytest.approx(belief.primary - 60 * ASLEEP, abs=1e-3)
    heard_it = twin.predict(up, HOUR + 2000)
    assert heard_it.primary == pytest.approx(belief.primary - 60 * ASLEEP - 0.9 * 0.027, abs=0.001)
    again = twin.update(up, Permitted(), HOUR + 1000)
    assert again is not None
    assert twin.predict(again, HOUR + 2000).primary == pytest.approx(heard_it.primary, abs=1e-3)
    docked = twin.update(twin.predict(up, HOUR + 600_000), Docked(), HOUR + 600_000)
    assert (
        docked is not None and docked.mode is Mode.CHARGING_PRIMARY and Source.DOCKING in docked.learned_from
    )
    charged = twin.predict(docked, 8 * HOUR)
    assert charged.primary > 0.98 and charged.heard_ms == 0
    down = twin.update(charged, Released(20.0, 30.0), 8 * HOUR)
    assert down is not None and down.mode is Mode.ASLEEP
    assert (down.north_m, down.east_m) == (20.0, 30.0)
    assert down.primary == pytest.approx(1 - 0.027 - IDLE, abs=0.01)


def test_silence_from_the_surface_says_that_it_stayed_below() -> None:
    twin = Twin(replace(KNOWLEDGE, calls=CallParameters(30_000, 0.1)), ALWAYS_ASLEEP)
    told_up = told(twin, heard(0, State.SLEEPING, 0.5), (Permitted(), HOUR))
    assert twin.predict(told_up, HOUR + 59_000).probability_of(Mode.SURFACING) == pytest.approx(0.9)
    # Bayes: 0.09 / (0.09 + 0.1) when the first call is due and not received, 0.009 / (0.009 + 0.1) after the second.
    assert twin.predict(told_up, HOUR + 60_000).probability_of(Mode.FLOATING) == pytest.approx(
        0.4737, abs=1e-4
    )
    silent = twin.predict(told_up, HOUR + 91_000)
    assert silent.probability_of(Mode.FLOATING) == pytest.approx(0.0826, abs=1e-4)
    assert silent.mode is Mode.ASLEEP
    again = twin.update(silent, Permitted(), HOUR + 91_000)
    assert again is not None and again.probability_of(Mode.SURFACING) == pytest.approx(0.9)
    # Its motors have run at most once: for the first permission as probably as before, or for none.
    once = told(twin, heard(0, State.SLEEPING, 0.5), (Permitted(), HOUR + 91_000))
    floats = 0.5 - 60 * ASLEEP - 0.027 - IDLE - 0.003 * 31 / 60
    assert again.primary == pytest.approx((1 - 0.0826) * once.primary + 0.0826 * floats, abs=3e-4)
    up = twin.update(twin.predict(again, HOUR + 160_000), *heard(HOUR + 160_000, State.FLOATING, 0.46, 1))
    assert up is not None
    assert twin.predict(up, HOUR + 900_000).probability_of(Mode.FLOATING) == pytest.approx(1.0)


def test_one_that_is_up_too_early_for_a_repeated_permission_obeyed_the_first() -> None:
    """The aPad was too far off to hear it, and repeated: it has floated for five minutes more than the second explains."""
    twin = Twin(replace(KNOWLEDGE, calls=CallParameters(300_000, 0.1)), ALWAYS_ASLEEP)
    first = told(twin, heard(0, State.SLEEPING, 0.6), (Permitted(), HOUR))
    both = twin.update(twin.predict(first, HOUR + 400_000), Permitted(), HOUR + 400_000)
    assert both is not None
    floats = 0.6 - 60 * ASLEEP - 0.027 - IDLE - 0.003 * 6
    early_ms, late_ms = HOUR + 430_000, HOUR + 600_000
    once = twin.update(twin.predict(first, early_ms), *heard(early_ms, State.FLOATING, floats, 1))
    up = twin.update(twin.predict(both, early_ms), *heard(early_ms, State.FLOATING, floats, 1))
    assert up.primary == pytest.approx(once.primary, abs=1e-6)
    # Later, and unheard, it may have obeyed either.
    low, high = twin.predict(both, late_ms).charge_interval()
    assert low < floats - 0.003 * 2.8 and high > 0.6 - 70 * ASLEEP - 0.027 - IDLE - 0.003 * 2.3
    # A reading decides, and a copy from its plain data goes on alike.
    copy = twin.restored(1, json.loads(json.dumps(twin.kept(both))))
    assert twin.predict(copy, late_ms) == twin.predict(both, late_ms)


def test_a_first_reading_near_full_says_nothing_of_the_sensor() -> None:
    """Its sensor reads 0.033 too high, and it is not full: nobody knows that it rests at an end."""
    twin = Twin(replace(KNOWLEDGE, untold=UntoldParameters(0.4, 0.2, 0.05)), ALWAYS_ASLEEP)
    belief = None
    for n in range(12):
        belief = twin.update(belief, *heard(n * 600_000, State.SLEEPING, 0.97 - 10 * n * ASLEEP, n))
    truth = 0.97 - 0.033 - 110 * ASLEEP
    low, high = belief.charge_interval()
    assert low < truth < high
    assert belief.primary == pytest.approx(0.97 - 110 * ASLEEP, abs=0.02)


@pytest.mark.parametrize("calls", [CallParameters(300_000, 0.1), None])
def test_one_that_never_heard_its_permission_keeps_its_charge(calls: CallParameters | None) -> None:
    """It sleeps on the bottom, unheard for days: what floating would have cost is not taken from it."""
    twin = Twin(replace(KNOWLEDGE, calls=calls), ALWAYS_ASLEEP)
    belief = told(twin, heard(0, State.SLEEPING, 0.6), (Permitted(), HOUR))
    for hours in (2, 12, 14, 30, 47, 60, 90):
        later = twin.predict(belief, hours * HOUR)
        truth = 0.6 - 60 * hours * ASLEEP
        if calls is not None:
            low, high = later.charge_interval()
            assert low <= truth <= high, hours
            # Silence from the surface is evidence, so the charge is known about as well as without a permission.
            unasked = twin.predict(told(twin, heard(0, State.SLEEPING, 0.6)), hours * HOUR)
            assert later.primary == pytest.approx(unasked.primary, abs=0.005)
            assert later.mode is Mode.ASLEEP
        elif hours <= 30:
            # Without evidence one in ten did not hear it, and hardly any of them draws more than scheduled in a day.
            assert later.probability_at_most(truth - 0.03) < 0.96, hours


def test_while_it_may_have_obeyed_or_not_both_charges_are_believed() -> None:
    twin = Twin(replace(KNOWLEDGE, calls=CallParameters(300_000, 0.1)), ALWAYS_ASLEEP)
    belief = told(twin, heard(0, State.SLEEPING, 0.6), (Permitted(), HOUR))
    # One call is missing: 0.09 / (0.09 + 0.1) that it floats.
    unsure = twin.predict(belief, HOUR + 300_000)
    stayed, floats = 0.6 - 65 * ASLEEP, 0.6 - 60 * ASLEEP - 0.027 - 0.003 * 4
    assert unsure.probability_of(Mode.FLOATING) == pytest.approx(0.4737, abs=1e-3)
    assert unsure.primary == pytest.approx(0.4737 * floats + 0.5263 * stayed, abs=0.003)
    low, high = unsure.charge_interval()
    assert low < floats and stayed < high


def listens(twin: Twin, at_ms: int, state: State) -> Belief:
    return told(twin, heard(at_ms - HOUR, State.SLEEPING, 0.9), heard(at_ms, state, 0.9 - 60 * ASLEEP, 1))


@pytest.mark.parametrize("state", [State.ACTIVE, State.PROCESSING])
def test_a_sleeper_that_is_awake_for_a_moment_is_not_taken_for_awake_until_the_hour(state: State) -> None:
    """A board that came to rest, or booted, listens for a minute and then sleeps; a wake is as short."""
    cycle = CycleParameters.of([(60_000, 0.002), (HOUR, ASLEEP)], HOUR)
    schedules = {1: Schedule((0,), (Mode.ASLEEP,), cycle)}
    drain = replace(KNOWLEDGE.drain, listening=IDLE - ASLEEP)
    twin = Twin(replace(KNOWLEDGE, drain=drain, board=listening()), schedules)
    at_ms = 5 * HOUR + 120_000
    belief = listens(twin, at_ms, state)
    expected = Mode.IDLE if state is State.ACTIVE else Mode.ASLEEP
    assert belief.mode is expected
    later, slept = (
        twin.predict(it, at_ms + 50 * 60_000) for it in (belief, listens(twin, at_ms, State.SLEEPING))
    )
    assert later.probability_of(Mode.ASLEEP) == pytest.approx(1.0)
    assert slept.primary - later.primary == pytest.approx(
        (IDLE - ASLEEP) / 2 if state is State.ACTIVE else 0.0, abs=2e-4
    )


def test_a_released_one_may_wait_before_its_motors_run() -> None:
    """Its Wi-Fi was off in the dock, so it waits the whole two minutes, unless it is heard meanwhile and told."""
    drain = replace(KNOWLEDGE.drain, release_wait=0.004, listening=0.001)
    twin = Twin(
        replace(KNOWLEDGE, drain=drain, board=listening(motor_run_ms=60_000, release_wait_ms=120_000)),
        ALWAYS_ASLEEP,
    )
    docked = told(twin, heard(0, State.FLOATING, 0.9), (Docked(), 1000))
    let_go = twin.update(twin.predict(docked, 12 * HOUR), Released(0.0, 0.0), 12 * HOUR)
    assert let_go is not None and let_go.mode is Mode.FLOATING
    assert let_go.primary == pytest.approx(1.0, abs=1e-3)
    for seconds in (10, 60, 120, 170):
        waits = twin.predict(let_go, 12 * HOUR + 1000 * seconds)
        low, high = waits.charge_interval()
        assert high > 0.999 and low < 1 - 0.027 - IDLE - 0.001, seconds
    rests = twin.predict(let_go, 12 * HOUR + 240_000)
    assert rests.mode is Mode.ASLEEP
    assert rests.primary == pytest.approx(1 - 0.027 - IDLE - 0.001 - 0.004 - 4 * ASLEEP, abs=3e-4)
    heard_ms = 12 * HOUR + 60_000
    met = twin.update(twin.predict(let_go, heard_ms), *heard(heard_ms, State.RELEASED, 0.998, 1))
    sinks = twin.predict(met, heard_ms + 240_000)
    assert sinks.mode is Mode.ASLEEP
    assert sinks.primary == pytest.approx(met.primary - 0.027 - IDLE - 0.001 - 3 * ASLEEP, abs=4e-4)


def test_one_that_is_released_at_the_full_hour_misses_that_wake() -> None:
    """The alarm of a board that waits, sinks or listens wakes nobody: the next wake is an hour later."""
    cycle = CycleParameters.of([(60_000, 0.01), (HOUR, ASLEEP)], HOUR)
    twin = Twin(
        replace(
            KNOWLEDGE,
            board=listening(release_wait_ms=120_000),
            habits=replace(KNOWLEDGE.habits, unscheduled=0.0),
        ),
        {1: Schedule((0,), (Mode.ASLEEP,), cycle)},
    )
    docked = told(twin, heard(0, State.FLOATING, 0.9), (Docked(), 1000))
    let_go = twin.update(twin.predict(docked, 12 * HOUR), Released(0.0, 0.0), 12 * HOUR)
    assert let_go is not None
    before = 1 - 0.027 - IDLE
    assert twin.predict(let_go, 13 * HOUR - 1000).primary == pytest.approx(before - 60 * ASLEEP, abs=3e-4)
    assert twin.predict(let_go, 13 * HOUR + 600_000).primary == pytest.approx(
        before - 69 * ASLEEP - 0.01, abs=3e-4
    )


def test_how_fast_one_charges_is_learned_in_its_dock() -> None:
    """Its batteries hold a sixth less: it charges 20 % faster than the kind, and in its next docking that is known."""
    twin = Twin(
        replace(KNOWLEDGE, charger=replace(KNOWLEDGE.charger, deviation=0.02, rate_deviation=0.1)),
        ALWAYS_ASLEEP,
    )
    slow, fast = (KNOWLEDGE.charger.primary * rate * 0.00223 - 0.6 * ASLEEP for rate in (1.0, 1.2))
    belief = told(twin, heard(0, State.FLOATING, 0.2), (Docked(), 1000))
    for n in range(1, 13):
        charge = 0.2 + 10 * n * fast
        belief = twin.update(belief, *heard(n * 600_000, State.CHARGING, charge + 0.03, n)) or belief
    later = twin.predict(belief, 13 * 600_000)
    gained = later.primary - belief.primary
    assert gained > 10 * (0.5 * slow + 0.5 * fast)


def test_one_that_waits_to_sink_is_not_taken_for_one_that_has_sunk(twin: Twin) -> None:
    """Its motors run after a packet with RELEASED: a reading from before is no evidence of a bias."""
    docked = told(twin, heard(0, State.FLOATING, 0.9), (Docked(), 1000))
    full = twin.predict(docked, HOUR)
    down = twin.update(full, Released(0.0, 0.0), HOUR)
    before = state_of(down).mean.copy()
    waits = twin.update(down, *heard(HOUR + 30_000, State.RELEASED, 0.97, 1))  # 1.0 that sags by 0.03
    assert waits.primary == pytest.approx(down.primary, abs=0.003)
    assert state_of(waits).mean[2:] == pytest.approx(before[2:], abs=0.002)
    asleep = 1 - 0.027 - IDLE * 1.5
    sinks = twin.update(waits, *heard(HOUR + 60_000, State.SINKING, asleep + 0.0135, 2))
    # By then about half of the run is over: the rest is still to come.
    assert sinks.primary == pytest.approx(asleep, abs=0.012) and sinks.charge_cov[0] > 0.004**2
    lies = twin.update(sinks, *heard(3 * HOUR, State.SLEEPING, asleep - 120 * ASLEEP, 3))
    assert lies is not None and lies.primary == pytest.approx(asleep - 120 * ASLEEP, abs=0.006)


def test_drain_and_bias_of_one_are_learned_while_it_is_heard(untaught: Twin) -> None:
    rng = np.random.default_rng(2)
    drain, sag = 1.08, -0.022
    belief: Belief | None = None
    charge = 0.95
    for hour in range(60):
        awake = hour % 8 == 0
        reading = charge + (sag if awake else 0.0) + rng.normal(0, 0.015)
        state = State.ACTIVE if awake else State.SLEEPING
        belief = untaught.update(belief, *heard(hour * HOUR, state, min(1.0, reading), hour))
        charge -= drain * 60 * (IDLE if awake else ASLEEP)
    assert belief is not None
    learned, spread = state_of(belief).mean, np.sqrt(np.diag(state_of(belief).cov))
    assert learned[2] == pytest.approx(drain, abs=0.03) and spread[2] < 0.03
    assert learned[4] == pytest.approx(sag, abs=3 * spread[4]) and spread[4] < 0.005


def test_readings_at_the_end_of_the_scale_do_not_pull_a_full_battery_down() -> None:
    twin = Twin(KNOWLEDGE, {1: Schedule((0,), (Mode.ASLEEP,))})
    rng = np.random.default_rng(4)
    belief: Belief | None = None
    for n in range(300):
        reading = float(np.clip(1.0 + rng.normal(0, 0.015), 0, 1))
        belief = twin.update(belief, *heard(n * 600_000, State.CHARGING, min(1.0, reading + 0.03), n))
    assert belief is not None and belief.primary > 0.999
    assert state_of(belief).mean[3] == pytest.approx(0.0, abs=0.004)


def test_a_clock_that_gains_is_learned(untaught: Twin) -> None:
    belief: Belief | None = None
    for hour in range(200):
        at_ms = hour * HOUR
        ahead_ms = 2000 + round(at_ms * 30e-6)
        belief = untaught.update(belief, *heard(at_ms, State.SLEEPING, 0.9, hour, agent_ms=at_ms + ahead_ms))
    assert belief.clock.drift_ppm == pytest.approx(30, abs=3)
    assert belief.clock.offset_ms == pytest.approx(2000 + 199 * HOUR * 30e-6, abs=500)


def test_readings_near_to_each_other_are_one_and_change_nothing_else(untaught: Twin) -> None:
    belief = told(untaught, heard(0, State.ACTIVE, 0.9))
    variance = belief.charge_cov[0]
    for n in range(1, 200):
        found = untaught.update(belief, *heard(1000 * n, State.ACTIVE, 0.9 - n * IDLE / 60, n))
        assert found is not None
        belief = found
    assert belief.heard_ms == 199_000
    assert (
        belief.charge_cov[0] > variance / 2.5
    )  # 200 independent readings would leave one hundredth of the variance
    other = untaught.update(belief, *heard(200_000, State.PROCESSING, 0.87, 200))
    assert other is not None and other.mode is Mode.HIGH_LOAD


@pytest.mark.parametrize("theta", [1, 30])
def test_the_water_moves_it_in_mission_time_whatever_theta_is(theta: int) -> None:
    twin = Twin(replace(KNOWLEDGE, scale=TimeScale(theta)), {})
    belief = told(twin, heard(0, State.ACTIVE, 0.9, agent_ms=0))
    later = twin.predict(belief, 3_600_000)
    assert later.place_cov[0] - belief.place_cov[0] == pytest.approx(3600 * 0.001, rel=0.01)


def test_a_range_says_how_far_and_not_where() -> None:
    twin = Twin(replace(KNOWLEDGE, water=WaterParameters(0.01, 0.0, 3600.0, 1.0)), {})
    belief = twin.predict(told(twin, heard(0, State.ACTIVE, 0.9)), 10 * HOUR)
    ranged = twin.update(belief, Ranged(110.0, 3.0, -96.0, 0.25), 10 * HOUR)
    assert ranged.east_m == pytest.approx(14.0, abs=3.0) and ranged.north_m == pytest.approx(3.0, abs=0.1)
    assert ranged.place_cov[2] < belief.place_cov[2] / 5
    assert ranged.place_cov[0] == pytest.approx(belief.place_cov[0], rel=0.01)
    assert Source.RANGE in ranged.learned_from
    fixed = twin.update(ranged, Fixed(5.0, 12.0, 1.0), 10 * HOUR)
    assert fixed is not None and fixed.place_cov[0] < 1.0


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
    assert later is not None and state_of(later).packet == (30, 30 * HOUR - 5000)


@pytest.mark.parametrize(
    ("schedules", "state", "mode"),
    [
        (ALWAYS_ASLEEP, State.PROCESSING, Mode.ASLEEP),
        (ALWAYS_ASLEEP, State.ACTIVE, Mode.ASLEEP),
        (ALWAYS_ASLEEP, State.HOVERING, Mode.HIGH_LOAD),
        ({}, State.PROCESSING, Mode.HIGH_LOAD),
    ],
)
def test_one_that_is_asked_within_a_short_wake_is_not_taken_for_awake(
    schedules: dict[int, Schedule], state: State, mode: Mode
) -> None:
    twin = Twin(KNOWLEDGE, schedules)
    before = told(twin, *hourly(State.SLEEPING, 0.9, 60 * ASLEEP, 5))
    asked = twin.update(before, ShortStatus(1, state, 0.883, 1.0), 4 * HOUR + 600_000)
    assert asked is not None and asked.mode is mode and asked.state is state


@pytest.mark.parametrize(("deviations", "gated"), [(-4.0, 0), (4.0, 0), (-7.0, 1)])
def test_the_gate_stands_between_four_deviations_and_seven(twin: Twin, deviations: float, gated: int) -> None:
    steady = told(twin, *hourly(State.SLEEPING, 0.7, 60 * ASLEEP, 6))
    due = twin.predict(steady, 6 * HOUR)
    # The error of a reading asleep: charge, noise and bias, of which the last two are 0.015 and at most 0.004.
    sd = (state_of(due).cov[0, 0] + 0.015**2) ** 0.5
    odd = twin.update(due, *heard(6 * HOUR, State.SLEEPING, due.primary + deviations * sd, 6))
    assert odd is not None and state_of(odd).gated == gated


GPS = replace(KNOWLEDGE, water=WaterParameters(0.0, 0.1, 3600.0, 0.5, is_ground_truth=False, way_down_s=60.0))


def placed(at_ms: int, sequence: int, state: State, depth_m: float, north_m: float = 3.0) -> _Stamped:
    return StatusPacket(1, sequence, state, 0.9, 1.0, north_m, 4.0, depth_m, at_ms), at_ms


BELOW = [placed(n * HOUR, n, State.SLEEPING, 3.0) for n in range(10)]
AFLOAT = [placed(n * 10_000, n, State.FLOATING, 0.0) for n in range(5)]
TRUTHFUL = replace(GPS, water=replace(GPS.water, is_ground_truth=True))


@pytest.mark.parametrize(
    ("knowledge", "reports", "least", "most"),
    [
        # The error of the fix, and 0.1 m/s for the minute of the way down.
        pytest.param(GPS, BELOW[:1], 36.25, 36.25, id="from below"),
        pytest.param(GPS, BELOW, 36.25, 36.25, id="a place repeated from below makes nobody surer"),
        pytest.param(GPS, AFLOAT, 0.0, 0.5**2, id="fixes at the surface make surer"),
        pytest.param(
            GPS,
            [*AFLOAT[:1], (Docked(), 1000), (Released(3.0, 4.0), HOUR)],
            37.0,
            37.0,
            id="the way down does not",
        ),
        pytest.param(TRUTHFUL, BELOW, 0.0, 0.05, id="who states where it is is believed each time"),
    ],
)
def test_how_sure_a_place_is(
    knowledge: TwinParameters, reports: list[_Stamped], least: float, most: float
) -> None:
    variance = told(Twin(knowledge, ALWAYS_ASLEEP), *reports).place_cov[0]
    assert least * (1 - 1e-6) <= variance <= most * (1 + 1e-6)


def test_a_fix_as_it_left_the_surface_which_no_packet_had_stated_is_weighed() -> None:
    below = placed(120_000, 5, State.SLEEPING, 3.0, north_m=3.4)
    assert 3.0 < told(Twin(GPS, ALWAYS_ASLEEP), *AFLOAT, below).north_m < 3.4


@pytest.mark.parametrize("stated", [0.04, 0.5, 0.96])
def test_a_learning_twin_believes_the_first_reading_of_the_secondary_within_the_greatest_bias(
    stated: float,
) -> None:
    """An empty or full secondary that reads 0.5 has a bias of a half, which no board has."""
    twin = Twin(replace(KNOWLEDGE, untold=UntoldParameters(0.4, 0.2, 0.05)), ALWAYS_ASLEEP)
    belief = told(twin, heard(HOUR, State.SLEEPING, 0.6, secondary=stated))
    assert belief.secondary == pytest.approx(stated, abs=0.05)
    assert sqrt(belief.charge_cov[2]) < 0.05


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
