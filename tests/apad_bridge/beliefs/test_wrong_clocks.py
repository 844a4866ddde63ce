"""A wrong stamp costs its own packet and no other; a clock that was really set is believed at its second packet."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from scenario_files import POOL_FILE

from agents.time_scale import TimeScale
from apad_bridge.assembly.flight_config import flight_config
from apad_bridge.assembly.flight_parts import fleet_beliefs
from apad_bridge.beliefs.fleet_beliefs import FleetBeliefs
from apad_bridge.beliefs.hold_last import HoldLast
from apad_bridge.beliefs.measurement import ClockSet, Permitted, measurement_of, measurement_row
from apad_bridge.beliefs.modes import Mode
from apad_bridge.records.checkpoint import Checkpoint, restore
from apad_bridge.scenario.blocks.estimator_options import Beliefs, EstimatorKind, TwinModel
from apad_bridge.scenario.loader import load
from firmware_model.packets import StatusPacket
from firmware_model.states import State

POOL = load(POOL_FILE)
MODEL = TwinModel(
    drain_deviation=0.1,
    sensor_noise=0.015,
    bias_deviation=0.01,
    unscheduled=0.03,
    fix_deviation_m=1.0,
    current_deviation_m_s=0.02,
)
THETA = POOL.theta
MINUTE, YEAR = 60_000, 366 * 86_400_000
CANNOT_SHOW = "a status of a time that its clock cannot show, unless another agrees"
OVERTAKEN = "a status that a newer one overtook"


def of_a_twin() -> FleetBeliefs:
    beliefs = Beliefs(estimator=EstimatorKind.TWIN, twin=MODEL)
    return fleet_beliefs(flight_config(replace(POOL, beliefs=beliefs)))


def of_the_last_packet() -> FleetBeliefs:
    return HoldLast([5], TimeScale(THETA))


FLEETS = {"hold_last": of_the_last_packet, "twin": of_a_twin}
both = pytest.mark.parametrize("made", FLEETS.values(), ids=FLEETS)
Made = Callable[[], FleetBeliefs]


def said(fleet: FleetBeliefs, at_ms: int, ahead_ms: int, primary: float = 0.7) -> str | None:
    """Takes in a packet at mission time `at_ms` from a clock that is `ahead_ms` ahead of the nominal one."""
    fleet.advance(at_ms)
    packet = StatusPacket(5, at_ms % 256, State.ACTIVE, primary, 1.0, 3.0, 4.0, 3.0, THETA * at_ms + ahead_ms)
    return fleet.hear(packet, at_ms)


Row = tuple[float, float, float, str | None]
"""The second at which it comes, the clock's lead in seconds of the mission, the charge, and why it is not believed."""
YEAR_S = YEAR / 1000 / THETA


def told_of(
    at_s: Iterable[float], ahead_s: float, charge: float = 0.7, why_not: str | None = None
) -> list[Row]:
    return [(it, ahead_s, charge, why_not) for it in at_s]


def set_by(ahead_s: float) -> list[Row]:
    """A clock that was set: what was true before is wrong then."""
    return [
        (3600, 0, 0.7, None),
        (3601, ahead_s, 0.7, CANNOT_SHOW),
        *told_of((3602, 3603), ahead_s, 0.68),
        (3604, 0, 0.7, CANNOT_SHOW),
        (3605, ahead_s, 0.68, None),
    ]


def restarts_at(up_s: int) -> list[Row]:
    """No packet is under way for more than a minute, so the one of a clock that began 1 s ago is none from before."""
    return [
        *told_of(range(up_s - 5, up_s), 0),
        *told_of((up_s + 1, up_s + 2), -up_s, 0.68),
        (up_s + 3, 0, 0.7, CANNOT_SHOW),
    ]


STORIES: dict[str, tuple[list[Row], float | None]] = {
    "a clock that was set ahead is believed at its second packet": (set_by(YEAR_S), 0.68),
    "a clock that was set back is believed at its second packet": (set_by(-3000), 0.68),
    "a board that restarts in its second minute is heard at once": (restarts_at(62), 0.68),
    "a board that restarts in its second hour is heard at once": (restarts_at(3600), 0.68),
    # Its first packet may be one from before that waited. It was unheard until its clock caught up with the former one.
    "one that restarts in its first minute is heard at its second packet": (
        [*told_of(range(5, 30, 5), 0), (30, -27, 0.68, OVERTAKEN), *told_of(range(35, 55, 5), -27, 0.68)],
        0.68,
    ),
    # One that was just switched on is heard at once.
    "a first packet may state any time and makes nobody deaf": (
        [
            (120, YEAR_S, 0.7, None),
            (121, 0, 0.7, CANNOT_SHOW),
            (122, 0, 0.7, None),
            *told_of(range(123, 180, 3), 0, 0.69),
        ],
        0.69,
    ),
    "two wrong stamps that disagree are not believed": (
        [
            (60, 0, 0.7, None),
            *((60 * n, YEAR_S * (n % 2 + 1), 0.7, CANNOT_SHOW) for n in (2, 3, 4)),
            (300, 0, 0.7, None),
        ],
        None,
    ),
    # The second is 20 minutes under way.
    "a late packet is news if nothing newer came, and says nothing of the clock": (
        [(3600, 0, 0.7, None), (5400, -1200, 0.7, None), (5401, 0, 0.7, None), (5402, -60, 0.7, OVERTAKEN)],
        None,
    ),
}


@both
@pytest.mark.parametrize(("rows", "believed"), STORIES.values(), ids=STORIES)
def test_story(made: Made, rows: list[Row], believed: float | None) -> None:
    fleet = made()
    for at_s, ahead_s, charge, why_not in rows:
        assert said(fleet, 1000 * at_s, round(1000 * THETA * ahead_s), charge) == why_not, at_s
    assert believed is None or fleet.get(5).primary == pytest.approx(believed, abs=0.02)


@both
@pytest.mark.parametrize("ahead_ms", [YEAR, 2**63 - 1, 2 * MINUTE * THETA, -30 * MINUTE * THETA])
def test_one_wrong_stamp_costs_one_packet(made: Made, ahead_ms: int) -> None:
    fleet, spared = made(), made()
    for it in (fleet, spared):
        assert said(it, 60 * MINUTE, 0) is None
    assert said(fleet, 61 * MINUTE, ahead_ms) == CANNOT_SHOW
    for it in (fleet, spared):
        assert said(it, 62 * MINUTE, 0, primary=0.69) is None
    assert fleet.kept() == spared.kept()
    # A true stamp in between ends the doubt: the next wrong stamp starts it again.
    assert said(fleet, 63 * MINUTE, ahead_ms + 5) == CANNOT_SHOW


def status(sequence: int, agent_ms: int) -> StatusPacket:
    return StatusPacket(5, sequence, State.ACTIVE, 0.7, 1.0, 3.0, 4.0, 3.0, agent_ms)


@both
@pytest.mark.parametrize(
    ("begins_ms", "packets", "why_not"),
    [
        pytest.param(
            30_000,
            [status(n, THETA * 5000 * n) for n in range(1, 5)],
            OVERTAKEN,
            id="packets of its first minute that waited are none of a restart",
        ),
        pytest.param(
            MINUTE, [status(9, YEAR)] * 3, CANNOT_SHOW, id="the same packet agrees with nothing but itself"
        ),
    ],
)
def test_packets_that_come_at_once(
    made: Made, begins_ms: int, packets: list[StatusPacket], why_not: str
) -> None:
    fleet = made()
    said(fleet, begins_ms, 0)
    fleet.advance(begins_ms + 1000)
    assert [fleet.hear(it, begins_ms + 1000 + n) for n, it in enumerate(packets)] == [why_not] * len(packets)
    assert said(fleet, begins_ms + 5000, 0) is None


@both
@given(
    honest_ahead_ms=st.integers(-YEAR, YEAR),
    stamps=st.lists(st.one_of(st.none(), st.integers(0, 2**64 - 1)), max_size=12),
)
def test_after_three_true_packets_a_board_is_heard_whatever_came_before(
    made: Made, honest_ahead_ms: int, stamps: list[int | None]
) -> None:
    """The one exception is a stamp that is wrong by less than a packet may be late, until the clock has reached it."""
    fleet, at_ms = made(), 2 * YEAR
    for wrong in stamps:
        at_ms += 1000
        said(fleet, at_ms, honest_ahead_ms if wrong is None else wrong - THETA * at_ms)
    at_ms += 3 * MINUTE
    assert [said(fleet, at_ms + 1000 * n, honest_ahead_ms) for n in range(3)][-1] is None


def test_to_a_twins_batteries_no_time_has_passed_when_its_clock_is_set() -> None:
    fleet, never_set = of_a_twin(), of_a_twin()
    for it in (fleet, never_set):
        said(it, 60 * MINUTE, 0)
        it.learn(5, Permitted(), 61 * MINUTE)
    fleet.learn(5, ClockSet(YEAR), 61 * MINUTE)
    for it in (fleet, never_set):
        it.advance(62 * MINUTE)
    set_anew, steady = fleet.get(5), never_set.get(5)
    charge, expected = ([it.primary, *it.charge_cov] for it in (set_anew, steady))
    assert charge == pytest.approx(expected, abs=1e-12)
    assert set_anew.mode is steady.mode and set_anew.mode in (Mode.SURFACING, Mode.FLOATING)
    assert set_anew.clock.offset_ms == YEAR - THETA * 61 * MINUTE


@both
def test_a_clock_that_was_set_is_in_the_notebook(made: Made, tmp_path: Path) -> None:
    assert measurement_of(measurement_row(5, ClockSet(9), 7)) == (5, ClockSet(9), 7)
    fleet, resumed = made(), made()
    book = Checkpoint(tmp_path / "checkpoint.jsonl", fleet, 0)
    for at_ms, ahead_ms in ((60, 0), (61, -60 * MINUTE * THETA), (62, -60 * MINUTE * THETA)):
        said(fleet, at_ms * MINUTE, ahead_ms)
        book.flush(at_ms * MINUTE)
    book.close()
    assert restore(tmp_path / "checkpoint.jsonl", resumed).whole and resumed.kept() == fleet.kept()
    assert said(resumed, 63 * MINUTE, -60 * MINUTE * THETA) is None
