"""The ring in flash against a plain list: its records, recovery after a reset, torn and overwritten records."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, rule

from firmware_model.packets.sample_record import RECORD_BYTES, SampleRecord
from firmware_model.sampling.flash import PAGE_BYTES, PAGES, MemoryFlash, Ring
from firmware_model.sampling.flash_log import FlashLog
from firmware_model.sampling.sensors import NO_COUNTS

PAGES_HERE, A_PAGE = 4, 3
SMALL = (PAGES_HERE, A_PAGE * RECORD_BYTES + 5)


def record(sequence: int) -> SampleRecord:
    return SampleRecord(sequence, 1000 * sequence, (sequence % 65536, *NO_COUNTS[1:]), sequence % 16)


def filled(count: int, flash: MemoryFlash | None = None, acknowledged: int = 0) -> FlashLog:
    log = FlashLog(MemoryFlash(*SMALL) if flash is None else flash, 0, acknowledged)
    for sequence in range(count):
        log.append(record(sequence))
    return log


def sequences(log: FlashLog) -> list[int]:
    return [found.sequence for found in log.read(0, 10**9)]


# Four pages of three records: the current page and the two before it count; the fourth is the next to be erased.
@pytest.mark.parametrize(
    ("count", "held"), [(2, range(2)), (8, range(8)), (9, range(3, 9)), (13, range(6, 13))]
)
def test_what_it_holds_by_hand(count: int, held: range) -> None:
    assert sequences(filled(count)) == list(held)


def test_the_real_one_holds_99_days_of_a_sample_an_hour() -> None:
    ring = Ring(PAGES, PAGE_BYTES)
    assert ring.records_a_page == 170
    assert min(n - ring.oldest(n) for n in range(5000, 5500)) == 2380 > 99 * 24


def test_it_is_read_in_parts_and_only_what_is_next_or_there_is_written_and_acknowledged() -> None:
    log = filled(8)
    assert (log.read(2, 4), log.read(8, 20)) == ((record(2), record(3)), ())
    assert (log.newest(), filled(0).newest()) == (record(7), None)
    with pytest.raises(ValueError, match="comes next"):
        log.append(record(9))
    assert not log.acknowledge(9)


def test_flash_is_programmed_once_and_within_a_page() -> None:
    flash = MemoryFlash(2, 100)
    flash.program(90, b"0123456789")
    for at, data in ((95, b"x"), (190, b"0123456789x"), (200, b"x")):
        with pytest.raises(ValueError):
            flash.program(at, data)
    flash.erase(0)
    flash.program(95, b"x")
    assert flash.read(94, 3) == b"\0x\0"


@given(count=st.integers(0, 30), kept=st.integers(0, RECORD_BYTES - 1))
def test_a_torn_last_write_is_dropped_and_counted(count: int, kept: int) -> None:
    flash = MemoryFlash(*SMALL)
    log = filled(count, flash)
    if count % A_PAGE == 0:
        flash.erase(log.ring.page(count))
    data = record(count).encode()[:kept]
    flash.program(log.ring.address(count), data)
    used = any(data)  # a torn record keeps its sequence, also at the begin of a page

    again = FlashLog(flash, count, 0)
    assert (again.torn, again.next_sequence) == (any(data), count + used)
    held = [n for n in range(count) if n >= again.ring.oldest(count + used)]
    assert sequences(again) == held
    for sequence in range(again.next_sequence, again.next_sequence + 20):
        again.append(record(sequence))
    assert again.newest() == record(again.next_sequence - 1)


def test_a_bit_that_fell_over_costs_that_record_alone() -> None:
    flash = MemoryFlash(*SMALL)
    log = filled(5, flash)
    flash._pages[0][RECORD_BYTES + 7] ^= 0x10
    assert sequences(log) == sequences(FlashLog(flash, 5, 0)) == [0, 2, 3, 4]


def test_no_sequence_is_given_twice_when_flash_and_registers_disagree() -> None:
    flash = MemoryFlash(*SMALL)
    filled(8, flash)
    empty, behind = FlashLog(MemoryFlash(*SMALL), 7, 2), FlashLog(flash, 5, 0)
    assert (empty.next_sequence, empty.torn, sequences(empty)) == (7, 7, [])
    assert (behind.next_sequence, behind.torn) == (8, 0)


class Life(RuleBasedStateMachine):
    """Samples, acknowledgements and resets, beside a complete list."""

    def __init__(self) -> None:
        super().__init__()
        self.flash = MemoryFlash(*SMALL)
        self.log = FlashLog(self.flash, 0, 0)
        self.taken = 0
        self.acknowledged = 0
        self.unreadable: set[int] = set()
        self.registers = 0

    @rule(count=st.integers(1, 8))
    def samples(self, count: int) -> None:
        for _ in range(count):
            self.log.append(record(self.taken))
            self.taken += 1

    @rule(part=st.floats(0, 1))
    def acknowledges(self, part: float) -> None:
        upto = round(part * self.taken)
        assert self.log.acknowledge(upto) == (upto > self.acknowledged)
        self.acknowledged = max(self.acknowledged, upto)

    @rule()
    def registers_are_kept(self) -> None:
        self.registers = self.taken

    @rule()
    def resets(self) -> None:
        """A reset; the registers take the recovered values again."""
        self.log = FlashLog(self.flash, self.registers, self.acknowledged)
        self.registers = self.log.next_sequence

    @rule(kept=st.integers(1, RECORD_BYTES - 1))
    def is_torn(self, kept: int) -> None:
        """Power fails while a record is written."""
        ring = self.log.ring
        if self.taken % ring.records_a_page == 0:
            self.flash.erase(ring.page(self.taken))
        self.flash.program(ring.address(self.taken), record(self.taken).encode()[:kept])
        self.unreadable.add(self.taken)
        self.taken += 1
        self.resets()

    @invariant()
    def it_holds_what_it_must(self) -> None:
        first = max(0, (self.taken // A_PAGE - PAGES_HERE + 2) * A_PAGE)
        found = self.log.next_sequence, self.log.overwritten, self.log.waiting
        read = max(first, self.acknowledged)
        assert found == (self.taken, read - self.acknowledged, self.taken - read)
        assert sequences(self.log) == [n for n in range(first, self.taken) if n not in self.unreadable]


TestLife = Life.TestCase
TestLife.settings = settings(max_examples=60, stateful_step_count=30, deadline=None)
