"""The effects of an aPad's commands on a board, and the commands that it refuses."""

from dataclasses import replace
from functools import partial

import pytest

from firmware_model.actions import Action, Buoyancy, Dropped, RunBuoyancy, SendStatus, StateChanged
from firmware_model.bench import Bench
from firmware_model.config import BoardConfig, LastResort
from firmware_model.packets import (
    PLAIN,
    Beacon,
    Command,
    CommandPacket,
    HoverAt,
    Kind,
    LogAck,
    SetThreshold,
    SleepSchedule,
    SlotAssignment,
    Threshold,
)
from firmware_model.packets.codec import MusselbedCodec
from firmware_model.packets.commands import parse_command
from firmware_model.power.active_battery import ActiveBattery
from firmware_model.states import State
from firmware_model.table_one import FIELD, HOURLY, WORST_CASE, board, power
from tests.firmware_model.conftest import asleep, lines_of, lives

HOUR = 3_600_000


changes = partial(lines_of, kinds=(StateChanged,))


def test_a_sleep_schedule_moves_the_alarm_and_the_length_of_a_wake(bench: Bench) -> None:
    bench.hear(SleepSchedule(1, alarm_ms=900_000, wake_ms=30_000))
    assert changes(bench.run(minutes=30)) == [
        "900000 SLEEPING -ALARM_RANG-> SAMPLING",
        "930000 SAMPLING -WAKE_OVER-> SLEEPING",
        "1800000 SLEEPING -ALARM_RANG-> SAMPLING",
        "1830000 SAMPLING -WAKE_OVER-> SLEEPING",
    ]


def test_a_board_without_a_timeslot_speaks_in_the_one_that_it_is_given(bench: Bench) -> None:
    bench.hear(SlotAssignment(1, frame_ms=60_000, slot_ms=3000, guard_ms=200, index=5, offset_ms=-50))
    bench.run(hours=1.1)
    assert [sent.at_ms for sent in bench.did(SendStatus)] == [HOUR + 15_150]


def test_the_low_level_and_the_safe_level_are_where_they_were_told_to_be() -> None:
    bench = asleep(primary=0.9)
    bench.hear(SetThreshold(1, Threshold.LOW_LEVEL, 0.898))
    bench.run(hours=1)
    assert "LOW_LEVEL_REACHED" in str(changes(bench.trace))
    bench = asleep(last_resort=LastResort.CALL, primary=0.002, secondary=0.5)
    bench.hear(SetThreshold(1, Threshold.SAFE_LEVEL, 0.499))
    bench.run(hours=24)
    call = next(sent.at_ms for sent in bench.did(SendStatus))
    emptied = next(int(line.split()[0]) for line in changes(bench.trace) if "BATTERY_EMPTIED" in line)
    # 0.001 of the backup at the sleeping load is 14.83 min; the packet has it to 1/65535.
    assert (call - emptied) / 60_000 == pytest.approx(0.001 / 0.0000674288, rel=0.02)


def test_the_level_to_switch_back_at_is_where_it_was_told_to_be() -> None:
    bench = asleep(primary=0.0, secondary=0.9)
    bench.hear(SetThreshold(1, Threshold.SWITCH_BACK, 0.02))
    assert bench.board.feed is ActiveBattery.SECONDARY
    bench.charge_pin_rises()
    # 0.02 at 1.2435 times 0.001045 a minute: 15.4 min.
    bench.run(minutes=15.2)
    assert bench.board.feed is ActiveBattery.SECONDARY
    bench.run(minutes=0.4)
    assert bench.board.feed is ActiveBattery.PRIMARY


@pytest.mark.parametrize(
    "command",
    [
        SleepSchedule(1, 0, 0),
        SleepSchedule(1, 10_000, 10_000),
        SleepSchedule(1, 10_000, 0),
        SlotAssignment(1, 0, 0, 0, 0, 0),
        SlotAssignment(1, 60_000, 3000, 100, 20, 0),
        SlotAssignment(1, 60_000, 3000, 3000, 0, 0),
    ],
)
def test_what_cannot_be_is_refused_and_changes_nothing(bench: Bench, command: Command) -> None:
    (dropped,) = [action for action in bench.hear(command) if isinstance(action, Dropped)]
    assert dropped.reason == f"a {command.kind.name} that cannot be"
    assert bench.board.kept is None


def test_a_board_that_never_sleeps_takes_no_schedule() -> None:
    assert "cannot be" in str(asleep(None).hear(SleepSchedule(1, 60_000, 10_000)))


def hovered(actions: list[Action]) -> list[tuple[int, int | None]]:
    return [
        (action.at_ms, action.depth_mm)
        for action in actions
        if isinstance(action, RunBuoyancy) and action.to is Buoyancy.HOVER
    ]


def test_it_hovers_at_the_depth_that_it_was_told_and_keeps_to_it(bench: Bench) -> None:
    bench.hear(HoverAt(1, 1.25))
    bench.run(minutes=15)
    assert hovered(bench.trace) == [(120_000, 1250), (720_000, 1250)]
    lives(bench, "sink 2min")
    bench.trace.clear()
    bench.command(Kind.HOVER)
    assert hovered(bench.trace) == [(bench.now_ms, None)]


def test_it_does_not_hover_at_the_surface(bench: Bench) -> None:
    assert "by permission only" in str(bench.hear(HoverAt(1, 0.0)))
    assert bench.state is State.SLEEPING


def floating_for_its_life() -> Bench:
    config = replace(board(HOURLY, power(LastResort.SURFACE)), float_timeout_ms=600_000)
    bench = Bench(config, primary=0.0, secondary=0.19)
    # All its radios are on: 0.0022 a minute. It does not go down again by itself after 10 min.
    bench.run(minutes=20)
    assert bench.state is State.FLOATING
    return bench


def test_one_that_came_up_for_its_life_goes_down_when_told_and_stays_for_the_stated_time() -> None:
    bench = floating_for_its_life()
    told_ms = bench.now_ms
    bench.command(Kind.SINK)
    assert changes(bench.run(hours=6.1)) == [
        f"{told_ms + 60_000} SINKING -BOTTOM_REACHED-> ACTIVE",
        f"{told_ms + 60_000} ACTIVE -BATTERY_EMPTIED-> EMPTY",
        f"{told_ms + 6 * HOUR} EMPTY -LAST_RESORT_SURFACE-> SURFACING",
        f"{told_ms + 6 * HOUR + 60_000} SURFACING -SURFACE_REACHED-> FLOATING",
    ]


def test_down_again_it_still_surfaces_when_it_is_permitted() -> None:
    bench = floating_for_its_life()
    lives(bench, "sink 1h permission")
    assert bench.state is State.SURFACING


@pytest.mark.parametrize(
    ("state", "script"),
    [
        (State.SURFACING, "permission"),
        (State.FLOATING, "permission 2min"),
        (State.RELEASED, "permission 2min rises 1min falls 100ms"),
        (State.HOVERING, "hover 2min"),
    ],
    ids=lambda it: it.name if isinstance(it, State) else "",
)
def test_it_sinks_when_told_from_wherever_it_can(bench: Bench, state: State, script: str) -> None:
    lives(bench, script)
    assert bench.state is state
    bench.command(Kind.SINK)
    assert bench.state is State.SINKING


def test_docked_it_does_not_sink() -> None:
    bench = Bench(board(HOURLY, power()), docked=True)
    bench.run(minutes=1)
    assert "CHARGING does not take SINK_ORDERED" in str(bench.command(Kind.SINK))


WORST = BoardConfig(1, WORST_CASE, 50, 2000, 12 * HOUR, 120_000)
COMMANDS: list[Command] = [
    *(CommandPacket(kind, 1) for kind in sorted(PLAIN)),
    SleepSchedule(1, 60_000, 1000),
    SlotAssignment(1, 60_000, 1000, 10, 0, 0),
    Beacon(1, 1000),
    LogAck(1, 1),
    HoverAt(1, 1.0),
    SetThreshold(1, Threshold.SAFE_LEVEL, 0.2),
]


@pytest.mark.parametrize("command", COMMANDS, ids=lambda it: it.kind.name)
def test_the_worst_case_knows_permission_release_ping_and_sink(command: Command) -> None:
    known = command.kind in (Kind.PERMISSION, Kind.RELEASE, Kind.PING, Kind.SINK)
    found = parse_command(command.encode(), MusselbedCodec(), WORST)
    assert found == (command if known else f"the worst case knows no {command.kind.name}")
    whole = board(HOURLY, power())
    assert parse_command(command.encode(), MusselbedCodec(), whole) == command


def test_commands_do_not_reach_the_configuration_that_boards_share() -> None:
    config = board(FIELD, power())
    before = replace(config)
    bench = Bench(config)
    bench.run(minutes=2)
    bench.hear(SleepSchedule(1, 900_000, 30_000))
    bench.hear(SetThreshold(1, Threshold.SAFE_LEVEL, 0.3))
    assert config == before
    other = Bench(config)
    other.run(hours=1)
    assert other.state is State.SAMPLING
