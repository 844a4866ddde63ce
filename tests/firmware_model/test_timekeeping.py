"""Alarms and timeslots on a clock that drifts: beacons, doubt, and the law that no board transmits outside its timeslot."""

from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from firmware_model.actions import Action, Dropped, SendStatus, StateChanged
from firmware_model.bench import Bench
from firmware_model.config import BoardConfig, Cycle, Timekeeping, Timeslots
from firmware_model.packets import Beacon, Packet, SleepSchedule, SlotAssignment
from firmware_model.settings import Settings
from firmware_model.stimuli import ResetCause
from firmware_model.table_one import FIELD, HOURLY, board, power
from tests.firmware_model.conftest import lines_of

NOT_SENT = "dropped: a status: no beacon came, and the clock may be off by more than the guard"


def told(actions: list[Action], since_ms: int = 0) -> list[str]:
    return lines_of((it for it in actions if it.at_ms >= since_ms), (StateChanged, Dropped))


def config(
    cycle: Cycle = FIELD, drift_ppb: int = 0, bound_ppb: int | None = None, guard_ms: int = 0
) -> BoardConfig:
    it = board(replace(cycle, slots=cycle.slots and replace(cycle.slots, guard_ms=guard_ms)), power())
    assert it.whole is not None
    timekeeping = None if bound_ppb is None else Timekeeping(bound_ppb, beacon_wait_ms=120_000)
    return replace(it, drift_ppb=drift_ppb, whole=replace(it.whole, timekeeping=timekeeping))


Heard = list[tuple[int, Packet]]
STORIES: dict[str, tuple[BoardConfig, Heard, int, int, list[str]]] = {
    # 100 parts in a million fast: its hour is 3 600 000 / 1.0001 ms.
    "the alarm rings by the board's own clock": (
        config(HOURLY, 100_000),
        [],
        3_600_000,
        3_000_000,
        ["3599641 SLEEPING -ALARM_RANG-> SAMPLING"],
    ),
    # Timeslot 0 of the frame at 65 min, 100 ms guard: a clock 100 parts in a million slow reads that 390 ms late.
    "the slot opens by the board's own clock and it speaks a guard later": (
        config(drift_ppb=-100_000, guard_ms=100),
        [],
        5_400_000,
        3_800_000,
        [
            "3900491 AWAITING_SLOT -SLOT_OPENED-> TRANSMITTING",
            "3901491 TRANSMITTING -WAKE_OVER-> SLEEPING",
        ],
    ),
    # 20 parts in a million may be more than 100 ms after 5000 s: at 65 min it may transmit, at 125 min not.
    "in doubt it does not speak and sleeps again when no beacon comes": (
        config(bound_ppb=20_000, guard_ms=100),
        [],
        9_000_000,
        3_800_000,
        [
            "3900100 AWAITING_SLOT -SLOT_OPENED-> TRANSMITTING",
            "3901100 TRANSMITTING -WAKE_OVER-> SLEEPING",
            "7200000 SLEEPING -ALARM_RANG-> SAMPLING",
            "7210000 SAMPLING -SAMPLES_TO_PROCESS-> PROCESSING",
            "7270000 PROCESSING -PROCESSED-> AWAITING_SLOT",
            "7270000 AWAITING_SLOT -CLOCK_DOUBTED-> AWAITING_BEACON",
            f"7390000 {NOT_SENT}",
            "7390000 AWAITING_BEACON -WAKE_OVER-> SLEEPING",
        ],
    ),
    "in doubt a beacon lets it speak after all": (
        config(bound_ppb=20_000, guard_ms=100),
        [(7_300_000, Beacon(1, 7_300_000))],
        7_600_000,
        7_290_000,
        [
            "7300000 AWAITING_BEACON -BEACON_HEARD-> AWAITING_SLOT",
            "7500100 AWAITING_SLOT -SLOT_OPENED-> TRANSMITTING",
            "7501100 TRANSMITTING -WAKE_OVER-> SLEEPING",
        ],
    ),
    # 750 m at 1500 m/s: the beacon arrives 500 ms late, and the packet another 500 ms later; so the aPad assigns -1000 ms.
    "what is said arrives in the slot however far the aPad is": (
        config(guard_ms=100),
        [(600_500, Beacon(1, 600_000)), (600_500, SlotAssignment(1, 300_000, 5000, 100, 7, -1000))],
        6_000_000,
        3_700_000,
        [
            f"{3_600_000 + 300_000 + 35_000 + 100 - 500} AWAITING_SLOT -SLOT_OPENED-> TRANSMITTING",
            "3935600 TRANSMITTING -WAKE_OVER-> SLEEPING",
        ],
    ),
    # By hand: the wake ends at 3610 s; a frame begins at 3600 s, slot 7 of 3 s at 3621 s, its guard is 0.5 s.
    "a first slot is used at the end of the wake in which it was assigned": (
        board(HOURLY, power()),
        [(3_603_000, SlotAssignment(1, 300_000, 3000, 500, 7, 0))],
        3_660_000,
        3_611_000,
        [
            "3621500 AWAITING_SLOT -SLOT_OPENED-> TRANSMITTING",
            "3622500 TRANSMITTING -WAKE_OVER-> SLEEPING",
        ],
    ),
    # The wrong beacon rings the alarm that it passed. Set right, the clock reaches the hour 20 min later.
    "set right after a beacon of a week ahead it samples on": (
        config(HOURLY),
        [(1_800_000, Beacon(1, 606_600_000)), (2_400_000, Beacon(1, 2_400_000))],
        3_700_000,
        1_800_000,
        [
            "1800000 SLEEPING -ALARM_RANG-> SAMPLING",
            "1810000 SAMPLING -WAKE_OVER-> SLEEPING",
            "3600000 SLEEPING -ALARM_RANG-> SAMPLING",
            "3610000 SAMPLING -WAKE_OVER-> SLEEPING",
        ],
    ),
    # 5 min back in a wake: less than the hour of its alarms, but more than the minute of which it is told then.
    "a shorter schedule after a correction counts from now on": (
        config(HOURLY),
        [(3_605_000, Beacon(1, 3_305_000)), (3_606_000, SleepSchedule(1, 60_000, 20_000))],
        3_700_000,
        3_600_000,
        [
            "3600000 SLEEPING -ALARM_RANG-> SAMPLING",
            "3610000 SAMPLING -WAKE_OVER-> SLEEPING",
            "3660000 SLEEPING -ALARM_RANG-> SAMPLING",
            "3680000 SAMPLING -WAKE_OVER-> SLEEPING",
        ],
    ),
}
"""A board, what it hears, until when it lives, and what it does from a time on."""


@pytest.mark.parametrize(
    ("board_config", "heard", "until_ms", "since_ms", "lines"), STORIES.values(), ids=STORIES
)
def test_story(
    board_config: BoardConfig, heard: Heard, until_ms: int, since_ms: int, lines: list[str]
) -> None:
    bench = Bench(board_config)
    for at_ms, packet in heard:
        bench.run_until(at_ms)
        bench.hear(packet)
    bench.run_until(until_ms)
    assert told(bench.trace, since_ms) == lines


def test_a_beacon_sets_the_clock_and_with_it_alarm_and_slot() -> None:
    bench = Bench(config(drift_ppb=100_000))
    bench.run_until(3_000_000)
    assert bench.board.clock_ms(3_000_000) == 3_000_300
    bench.hear(Beacon(0, 3_000_000))
    assert (bench.board.clock_ms(3_000_000), bench.board.clock_offset_ms) == (3_000_000, 300)
    lines = told(bench.run(hours=0.5), 3_000_000)
    # 600 000 ms of its own after the beacon.
    assert lines[0] == "3599941 SLEEPING -ALARM_RANG-> SAMPLING"
    assert "3899911 AWAITING_SLOT -SLOT_OPENED-> TRANSMITTING" in lines


def test_a_beacon_that_cannot_be_and_one_for_another_are_dropped() -> None:
    bench = Bench(config())
    bench.run(minutes=2)
    assert "a time that cannot be" in str(bench.hear(Beacon(1, 2**64 - 1)))
    assert "for another aMussel" in str(bench.hear(Beacon(2, 1000)))
    assert bench.board.clock_ms(bench.now_ms) == bench.now_ms


@pytest.mark.parametrize("cause", ResetCause)
def test_a_reset_leaves_the_clock_and_what_it_was_told(cause: ResetCause) -> None:
    bench = Bench(config(drift_ppb=-50_000))
    bench.run_until(1_000_000)
    bench.hear(Beacon(1, 1_000_700))
    bench.hear(SlotAssignment(1, frame_ms=60_000, slot_ms=6000, guard_ms=500, index=3, offset_ms=-40))
    bench.run_until(2_000_000)
    reading_ms = bench.board.clock_ms(2_000_000)
    assert reading_ms == 1_000_700 + 1_000_000 - 50
    bench.reset(cause)
    assert bench.board.clock_ms(2_000_000) == reading_ms
    bench.run(hours=1.5)
    # Timeslot 3 opens at 18 s of every minute; 0.5 s guard, 40 ms less.
    (sent, *_) = bench.did(SendStatus, 2_000_000)
    spoke_ms = 1_000_700 + (sent.at_ms - 1_000_000) * (1 - 50e-6)
    assert spoke_ms % 60_000 == pytest.approx(18_460, abs=1)


FRAME_MS, SLOT_MS, GUARD_MS = 60_000, 4000, 400


@settings(deadline=None, max_examples=40)
@given(
    st.integers(-60_000, 60_000),
    st.integers(0, FRAME_MS // SLOT_MS - 1),
    st.lists(st.integers(0, 20_000_000), max_size=6),
)
def test_nobody_speaks_outside_of_its_slot_while_its_crystal_keeps_what_it_promises(
    drift_ppb: int, slot: int, beacons: list[int]
) -> None:
    cycle = replace(FIELD, alarm_ms=400_000, slots=Timeslots(FRAME_MS, SLOT_MS, GUARD_MS))
    bench = Bench(replace(config(cycle, drift_ppb, 60_000, GUARD_MS), slot=slot))
    for at_ms in sorted(beacons):
        bench.run_until(at_ms)
        bench.hear(Beacon(0, at_ms))
    bench.run_until(20_000_000)
    spoken = [sent.at_ms for sent in bench.did(SendStatus)]
    assert spoken  # for 400 ms / 60 ppm = 6667 s after the start at the least
    for at_ms in spoken:
        into_ms = at_ms % FRAME_MS - slot * SLOT_MS
        # It is off by at most the guard either way, and a millisecond for the rounding up; transmit_ms is 1000.
        assert 0 <= into_ms <= 2 * GUARD_MS + 1 and into_ms + 1000 <= SLOT_MS
    assert sum("CLOCK_DOUBTED" in line for line in told(bench.trace)) or len(beacons) >= 2


@given(
    st.integers(1, 50_000),
    st.integers(1, 20),
    st.integers(0, 19),
    st.integers(-100_000, 100_000),
    st.integers(0, 10**12),
)
def test_the_next_time_to_speak_is_the_first_one_of_its_slot(
    slot_ms: int, slots: int, slot: int, offset_ms: int, reading_ms: int
) -> None:
    frame_ms, slot = slot_ms * slots, slot % slots
    it = Settings(1000, 10, frame_ms, slot_ms, slot_ms // 3, slot, offset_ms, 0, 0, 0)
    at_ms = it.transmits_at_ms(reading_ms)
    assert reading_ms <= at_ms < reading_ms + frame_ms
    assert (at_ms - slot * slot_ms - slot_ms // 3 - offset_ms) % frame_ms == 0
