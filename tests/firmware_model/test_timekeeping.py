"""Alarms and timeslots on a clock that drifts: beacons, doubt, and the law that no board transmits outside its timeslot."""

from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from firmware_model.actions import Action, Dropped, SendStatus, StateChanged
from firmware_model.bench import Bench
from firmware_model.config import BoardConfig, Cycle, Timekeeping, Timeslots
from firmware_model.packets import Beacon, SlotAssignment
from firmware_model.settings import Settings
from firmware_model.states import State
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


def test_the_alarm_rings_by_the_board_s_own_clock() -> None:
    # 100 parts in a million fast: its hour is 3 600 000 / 1.0001 ms.
    bench = Bench(config(HOURLY, 100_000))
    assert told(bench.run(hours=1), 3_000_000) == ["3599641 SLEEPING -ALARM_RANG-> SAMPLING"]


def test_the_slot_opens_by_the_board_s_own_clock_and_it_speaks_a_guard_later() -> None:
    bench = Bench(config(drift_ppb=-100_000, guard_ms=100))
    bench.run(hours=1.5)
    (sent,) = bench.did(SendStatus)
    # Timeslot 0 of the frame at 65 min, 100 ms guard: a clock 100 parts in a million slow reads that 390 ms late.
    assert sent.at_ms == pytest.approx(3_900_100 * 1.0001, abs=1.5)


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


def test_in_doubt_it_does_not_speak_and_sleeps_again_when_no_beacon_comes() -> None:
    # 20 parts in a million may be more than 100 ms after 5000 s: at 65 min it may transmit, at 125 min not.
    bench = Bench(config(bound_ppb=20_000, guard_ms=100))
    lines = told(bench.run(hours=2.5), 3_800_000)
    assert lines == [
        "3900100 AWAITING_SLOT -SLOT_OPENED-> TRANSMITTING",
        "3901100 TRANSMITTING -WAKE_OVER-> SLEEPING",
        "7200000 SLEEPING -ALARM_RANG-> SAMPLING",
        "7210000 SAMPLING -SAMPLES_TO_PROCESS-> PROCESSING",
        "7270000 PROCESSING -PROCESSED-> AWAITING_SLOT",
        "7270000 AWAITING_SLOT -CLOCK_DOUBTED-> AWAITING_BEACON",
        f"7390000 {NOT_SENT}",
        "7390000 AWAITING_BEACON -WAKE_OVER-> SLEEPING",
    ]


def test_in_doubt_a_beacon_lets_it_speak_after_all() -> None:
    bench = Bench(config(bound_ppb=20_000, guard_ms=100))
    bench.run_until(7_300_000)
    assert bench.state is State.AWAITING_BEACON
    assert told(bench.hear(Beacon(1, 7_300_000))) == ["7300000 AWAITING_BEACON -BEACON_HEARD-> AWAITING_SLOT"]
    assert told(bench.run(minutes=5)) == [
        "7500100 AWAITING_SLOT -SLOT_OPENED-> TRANSMITTING",
        "7501100 TRANSMITTING -WAKE_OVER-> SLEEPING",
    ]


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


def test_what_is_said_arrives_in_the_slot_however_far_the_apad_is() -> None:
    # 750 m at 1500 m/s: the beacon arrives 500 ms late, and the packet another 500 ms later; so the aPad assigns -1000 ms.
    bench = Bench(config(guard_ms=100))
    bench.run_until(600_500)
    bench.hear(Beacon(1, 600_000))
    bench.hear(SlotAssignment(1, frame_ms=300_000, slot_ms=5000, guard_ms=100, index=7, offset_ms=-1000))
    bench.run(hours=1.5)
    (sent,) = bench.did(SendStatus)
    assert sent.at_ms + 500 == 3_600_000 + 300_000 + 35_000 + 100


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


def test_a_first_slot_is_used_at_the_end_of_the_wake_in_which_it_was_assigned() -> None:
    """By hand: the wake ends at 3610 s; a frame begins at 3600 s, slot 7 of 3 s at 3621 s, its guard is 0.5 s."""
    bench = Bench(board(HOURLY, power()))
    bench.run(seconds=3603)
    bench.hear(SlotAssignment(1, 300_000, 3000, 500, 7, 0))
    bench.run(minutes=1)
    assert [it.at_ms for it in bench.did(SendStatus)] == [3_621_500]
