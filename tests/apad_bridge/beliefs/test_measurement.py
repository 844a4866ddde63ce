"""A checkpoint keeps measurements as rows: each kind of them comes back from its row as it was."""

import json

import pytest

from apad_bridge.beliefs.measurement import (
    ClockSet,
    Docked,
    Fixed,
    Measurement,
    Permitted,
    Ranged,
    Released,
    TimeslotSilent,
    measurement_of,
    measurement_row,
)
from firmware_model.packets import AcousticStatus, Reported, ShortStatus, StatusPacket, WifiStatus
from firmware_model.power.active_battery import ActiveBattery
from firmware_model.states import State
from firmware_model.stimuli import ResetCause

FIELDS = (5, 7, State.FLOATING, 0.1, 1 / 3, 12.34, -5.0, 3.0, 1_800_000)
COUNTS = (1000, 2000, 3000, 4095)
FULL = WifiStatus(
    *FIELDS, COUNTS, 70_000, 68_988, 69_000, 12, 1, ResetCause.BROWN_OUT, ActiveBattery.SECONDARY, 1026, -250
)
KINDS: tuple[Measurement, ...] = (
    StatusPacket(*FIELDS),
    AcousticStatus(*FIELDS, COUNTS, 70_000, 300),
    FULL,
    ShortStatus(5, State.LOST, 0.2, 1.0),
    TimeslotSilent(),
    Permitted(),
    Docked(),
    Released(1.5, -2.5),
    Fixed(1.5, -2.5, 4.0),
    Ranged(30.25, 1.5, -2.5, 0.25),
    ClockSet(1 << 50),  # type: ignore[arg-type]
)


@pytest.mark.parametrize("measurement", KINDS, ids=lambda it: type(it).__name__)
def test_it_comes_back_from_its_row(measurement: Measurement) -> None:
    row = json.loads(json.dumps(measurement_row(5, measurement, 60_000)))
    agent_id, found, at_ms = measurement_of(row)
    assert (agent_id, found, at_ms) == (5, measurement, 60_000)
    assert type(found) is type(measurement)


@pytest.mark.parametrize("row", [["heard", 5, 0], ["said", 5, 0], ["short", 5, 0, 99, 0.5, 0.5], [], None])
def test_no_other_row_is_one(row: list[object]) -> None:
    with pytest.raises((KeyError, TypeError, ValueError)):
        measurement_of(row)


def test_a_packet_changes_the_quantities_that_it_states_and_no_others() -> None:
    before = Reported(depth_m=9.0)
    assert before.after(StatusPacket(*FIELDS)).depth_m == 3.0 and before.depth_m == 9.0
    assert before.after(FULL).depth_m == 3.0
