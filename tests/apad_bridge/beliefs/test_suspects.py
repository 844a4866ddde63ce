"""aMussels whose packets contradict physics: what is told, what is not, and how wide a twin's interval becomes."""

from __future__ import annotations

import json
from dataclasses import replace

import pytest

from agents.time_scale import TimeScale
from apad_bridge.beliefs.belief import Belief
from apad_bridge.beliefs.measurement import Docked, Measurement, Released
from apad_bridge.beliefs.modes import Mode
from apad_bridge.beliefs.twin import Twin
from apad_bridge.beliefs.twin_parameters import (
    ChargerParameters,
    ClockParameters,
    Drain,
    Habits,
    Schedule,
    SensorParameters,
    TwinParameters,
    UntoldParameters,
    WaterParameters,
)
from firmware_model.config import BoardConfig
from firmware_model.packets import ShortStatus, StatusPacket
from firmware_model.sinking import Sinking
from firmware_model.states import State
from firmware_model.table_one import WORST_CASE

HOUR, MIN = 3_600_000, 60_000
_Stamped = tuple[Measurement, int]
"""A measurement and its mission time."""
ASLEEP = 0.0002
"""A minute: 0.012 an hour."""
PARAMETERS = TwinParameters(
    scale=TimeScale(1),
    drain=Drain((ASLEEP, 0.001, 0.003, 0.001, 0.003, ASLEEP, ASLEEP, ASLEEP, 0.0), 0.027, 0.003, 0.6),
    charger=ChargerParameters(((0.16197, 0.001045), (0.5634, 0.00223), (1.0, 0.002911)), 1.2435, 0.01),
    sensor=SensorParameters(0.005, (0.0,) * 4, (0.002,) * 4, 300_000),
    habits=Habits(HOUR, 0.0, 1.0, (1.0, 0.0, 0.0), 0.0, 24 * HOUR, 0.0, 1.0),
    water=WaterParameters(0.001, 0.0, 3600.0, 1.0),
    drain_deviation=0.05,
    ageing_per_day=0.001,
    clock=ClockParameters(1000.0, 20.0, 1000.0),
    board=BoardConfig(0, WORST_CASE, 50, 2000, float_timeout_ms=12 * HOUR, release_wait_ms=0),
    sinking=Sinking(3_000_000, 60_000, 60_000),
    untold=UntoldParameters(0.4, 0.2, 0.05),
)
TWIN = Twin(PARAMETERS, {1: Schedule((0,), (Mode.ASLEEP,))})
SURE = Twin(replace(PARAMETERS, untold=None), {1: Schedule((0,), (Mode.ASLEEP,))})
"""It is told its board, and learns none."""
SWUNG = Twin(
    replace(PARAMETERS, untold=UntoldParameters(0.4, 0.2, 0.05, 0.06)), {1: Schedule((0,), (Mode.ASLEEP,))}
)


def heard(at_ms: int, charge: float, state: State = State.SLEEPING) -> _Stamped:
    return StatusPacket(1, at_ms // MIN, state, charge, 1.0, 3.0, 4.0, 3.0, at_ms), at_ms


def told(*measurements: _Stamped, twin: Twin = TWIN) -> Belief:
    belief: Belief | None = None
    for measurement in measurements:
        belief = twin.update(belief, *measurement)
    assert belief is not None
    return belief


def asleep(begin: float, per_hour: float, hours: int) -> list[_Stamped]:
    return [heard(n * HOUR, begin - per_hour * n) for n in range(hours)]


def docked(begin: float, per_hour: float, hours: int, bias: float = 0.0) -> list[_Stamped]:
    charges = (min(1.0, begin + per_hour * (n + 1)) + bias for n in range(hours))
    return [
        heard(0, begin + bias, State.FLOATING),
        (Docked(), MIN),
        *(heard((n + 1) * HOUR, charge, State.CHARGING) for n, charge in enumerate(charges)),
    ]


RISING = asleep(0.5, -0.1, 3)
JUMPING = [*asleep(0.9, 0.012, 12), heard(12 * HOUR, 0.46)]
STANDING = asleep(0.8, 0.0, 30)
CODEC = docked(0.6, 0.2, 14, bias=-0.3)
MOVED = [*CODEC, (Released(0.0, 0.0), 15 * HOUR), heard(17 * HOUR, 0.66)]
"""A codec that takes 0.3 off stood at the end, and stays suspect when it moves."""
IN_ITS_DOCK = [(Docked(), 10 * HOUR), *(heard(n * HOUR, 0.8, State.CHARGING) for n in range(11, 25))]
REPEATED = [
    *JUMPING,
    (Docked(), 13 * HOUR),
    *(heard(13 * HOUR + n * 15 * MIN, 0.46, State.CHARGING) for n in range(1, 9)),
]
SUSPECTS: dict[str, tuple[list[_Stamped], str]] = {
    "it rises": (RISING, "its charge rises without a charger"),
    "by a short status": (
        [*asleep(0.5, 0.012, 3), (ShortStatus(1, State.SLEEPING, 0.7, 1.0), 3 * HOUR)],
        "its charge rises without a charger",
    ),
    "it does not fall": (
        [heard(n * HOUR, 0.5 + 0.003 * (n % 2)) for n in range(20)],
        "its charge does not fall",
    ),
    "it does not rise on a charger": (
        [*docked(0.5, 0.2, 1), heard(2 * HOUR, 0.703, State.CHARGING)],
        "its charge does not rise on a charger",
    ),
    "it falls on a charger": (
        [*docked(0.6, 0.2, 2), heard(2 * HOUR + 10 * MIN, 0.5, State.CHARGING)],
        "its charge falls on a charger",
    ),
    # Three coils' worth: 0.002911 a minute, times 1.24 coils, at 40 % of age: 0.36 an hour.
    "it rises too fast": (docked(0.1, 0.45, 2), "its charge rises faster than a charger can"),
    "it falls too fast": (
        [*asleep(0.9, 0.012, 3), heard(2 * HOUR + 10 * MIN, 0.3)],
        "its charge falls faster than its loads can",
    ),
    "it jumps": (JUMPING, "its charge jumps"),
    # Its first reading that stands looked like a jump.
    "it jumps, and repeats itself": (REPEATED, "its charge jumps"),
    # By hand: the least board falls by 0.7 * 0.012 an hour, 1.68 steps of 0.005. After three hours the sum of squares about
    # the mean is 5 * 1.68^2 = 14.1, and the probability is at most exp(-14.1 / 2) / (2 pi)^1.5 / 2 = 2.7e-5. After four it
    # is exp(-28.2 / 2) / (2 pi)^2 / sqrt(5) = 8.5e-9: below once in a million.
    "it stands for three hours": (asleep(0.8, 0.0, 4), ""),
    "it stands for four hours": (
        asleep(0.8, 0.0, 5),
        "its reading stands: 0.80 for 240 min of its time",
    ),
    # Two kinds of packets round to 0.8 and to 204 / 255, and to 0.802.
    "it stands but for rounding": (
        [heard(n * HOUR, (0.8, 0.802)[n % 2]) for n in range(5)],
        "its reading stands",
    ),
    "a dock does not move it": (
        [heard(0, 0.75), heard(HOUR, 0.738), (Docked(), 90 * MIN), heard(6 * HOUR, 0.738, State.CHARGING)],
        "its reading stands: 0.74 for 300 min of its time",
    ),
    "it stood at the end": (CODEC, "its reading stands"),
    "it stood at the end, and moved": (MOVED, "its charge jumps"),
    "it stood, and moved": ([*STANDING, heard(30 * HOUR, 0.45)], ""),
    "a dock in between explains a rise": (
        [*asleep(0.5, 0.012, 3), (Docked(), 3 * HOUR), (Released(0.0, 0.0), 5 * HOUR), heard(6 * HOUR, 0.9)],
        "",
    ),
    # Its sensor reads 0.05 too much: of a full battery for as long as it takes to fall by that, and of an empty one.
    "full, it stands rightly": ([heard(n * HOUR, 1.0) for n in range(6)], ""),
    "empty, it stands rightly": ([heard(n * HOUR, 0.05, State.CALLING) for n in range(20)], ""),
    "full on a charger, it stands rightly": (
        [
            heard(0, 0.9, State.FLOATING),
            (Docked(), MIN),
            *(heard(n * HOUR, 0.95, State.CHARGING) for n in range(3, 20)),
        ],
        "",
    ),
    "for a moment, it stands rightly": ([heard(n * 1000, 0.8) for n in range(100)], ""),
    # Noise, or a load that is switched off.
    "the same reading again, but not each time": (
        [heard(n * HOUR, 0.8 - 0.022 * (n // 2)) for n in range(20)],
        "",
    ),
}


@pytest.mark.parametrize(("measurements", "expected"), SUSPECTS.values(), ids=SUSPECTS)
def test_readings_that_no_board_of_its_kind_can_state_are_told_with_their_reason(
    measurements: list[_Stamped], expected: str
) -> None:
    found = reason(told(*measurements))
    assert found.startswith(expected) and bool(found) == bool(expected)


def reason(belief: Belief) -> str:
    return belief.suspicion.reason if belief.suspicion else ""


@pytest.mark.parametrize(
    ("measurements", "low", "high"),
    [
        pytest.param(JUMPING, (0, 0.1), (0.9, 1), id="no charge that a suspect states is believed"),
        pytest.param(STANDING, (0, 0.02), (0.98, 1), id="what stands is not read"),
        # A day and a half of 0.012 an hour from 0.8, with a bias of at most 0.05 and a noise of 0.005.
        pytest.param([*STANDING, heard(30 * HOUR, 0.45)], (0.37, 0.41), (0.49, 0.53), id="until it moves"),
        # After a night it is full, whatever is read.
        pytest.param([*STANDING[:10], *IN_ITS_DOCK], (0.95, 1), (1, 1), id="in a dock physics goes on"),
        pytest.param(MOVED, (0, 0.96), (0.96, 1), id="a codec that takes 0.3 off"),
        # Truly it holds 0.9 - 13 * 0.012, and 0.2 more an hour in a dock.
        pytest.param(REPEATED, (0, 1), (1, 1), id="a suspect that repeats a reading is not read"),
    ],
)
def test_a_suspect_s_interval(
    measurements: list[_Stamped], low: tuple[float, float], high: tuple[float, float]
) -> None:
    found = told(*measurements).charge_interval()
    assert low[0] <= found[0] <= low[1] and high[0] <= found[1] <= high[1]


def test_the_suspicion_lasts_and_knows_whether_a_dock_held_the_aMussel_since() -> None:
    fetched = told(*RISING, (Docked(), 9 * HOUR), (Released(0.0, 0.0), 10 * HOUR))
    beliefs = told(*RISING), fetched, told(*SUSPECTS["a dock does not move it"][0])
    assert [it.suspicion.was_docked for it in beliefs] == [False, True, True]
    assert reason(fetched).startswith("its charge rises without a charger")


@pytest.mark.parametrize("ageing", [0.0, 0.2, 0.4])
@pytest.mark.parametrize("load", [0.8, 1.0, 1.2])
@pytest.mark.parametrize("bias", [-0.05, 0.0, 0.05])
def test_an_old_or_thirsty_or_badly_calibrated_board_contradicts_nothing(
    ageing: float, load: float, bias: float
) -> None:
    assert told(*half_a_day_after_a_day(ageing, load, bias)).suspicion is None


def half_a_day_after_a_day(ageing: float, load: float, bias: float) -> list[_Stamped]:
    """A day in the water and twelve hours in a dock, by equations (1) and (2) step by step."""
    left, charge, at_ms = 1 - ageing, 0.85, 0
    measurements: list[_Stamped] = []

    def stated(state: State) -> _Stamped:
        return heard(at_ms, min(1.0, max(0.0, charge + bias)), state)

    for minute in range(36 * 60):
        at_ms, swims = minute * MIN, minute < 24 * 60
        if minute == 24 * 60:
            measurements += [stated(State.FLOATING), (Docked(), at_ms)]
        elif minute % 30 == 0:
            measurements.append(stated(State.SLEEPING if swims else State.CHARGING))
        coil = 0.001045 if charge <= 0.16197 else 0.00223 if charge <= 0.5634 else 0.002911
        gain = -ASLEEP * load if swims else 1.2435 * coil - 0.6 * ASLEEP * load
        charge = min(1.0, charge + gain / left)
    return measurements


@pytest.mark.parametrize("ageing", [0.0, 0.2, 0.4])
@pytest.mark.parametrize("load", [0.8, 1.2])
def test_a_dock_tells_what_is_left_of_a_capacity(ageing: float, load: float) -> None:
    """After a day in the water alone, whose slope is load and age together, the interval is still wide."""
    measurements = half_a_day_after_a_day(ageing, load, 0.0)
    docked_at = next(n for n, (it, _) in enumerate(measurements) if isinstance(it, Docked))
    before, after = told(*measurements[:docked_at]).capacity_left, told(*measurements).capacity_left
    assert before.high - before.low > 2 * (after.high - after.low) and after.high - after.low < 0.08
    assert after.low - 0.01 <= 1 - ageing <= after.high + 0.01
    assert told(*measurements, twin=SURE).capacity_left is None


def test_a_twin_that_learns_nothing_of_its_board_suspects_nobody() -> None:
    assert told(*asleep(0.5, -0.02, 8), twin=SURE).suspicion is None


def test_a_codec_that_takes_0_3_off_is_told_when_its_aMussel_is_full_and_its_interval_then_covers() -> None:
    """0.3, 0.5 and 0.7 could be true. Further readings at rest tell how far it is off."""
    before, full, later = (told(*docked(0.6, 0.2, hours, bias=-0.3)) for hours in (2, 4, 14))
    assert [reason(it).partition(":")[0] for it in (before, full)] == ["", "its reading stands"]
    low, high = full.charge_interval()
    assert low < 1.0 <= high and later.primary == pytest.approx(1.0, abs=0.03)


@pytest.mark.parametrize("twin", [TWIN, SWUNG])
def test_a_twin_goes_on_after_a_restart_in_the_middle_of_readings_that_stand(twin: Twin) -> None:
    begin = told(*asleep(0.8, 0.0, 4), twin=twin)
    restored = twin.restored(1, json.loads(json.dumps(twin.kept(begin))))
    for hour in range(4, 7):
        begin, restored = (twin.update(it, *heard(hour * HOUR, 0.8)) for it in (begin, restored))
        found, expected = ((it.suspicion, it.charge_interval()) for it in (restored, begin))
        assert found == expected
    assert reason(restored).startswith("its reading stands")
