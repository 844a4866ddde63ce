"""The fleet's flash file: its regions do not touch, and the writes of an unanswered window are undone."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from agents.nursery.flash_file import FlashRegion
from firmware_model.packets.sample_record import RECORD_BYTES, SampleRecord
from firmware_model.sampling.flash_log import FlashLog

A_PAGE = 3
PAGES, PAGE_BYTES = 5, A_PAGE * RECORD_BYTES + 7


@pytest.fixture
def fd(tmp_path: Path) -> Iterator[int]:
    descriptor = os.open(tmp_path / "samples.flash", os.O_RDWR | os.O_CREAT)
    yield descriptor
    os.close(descriptor)


def record(sequence: int, run: int = 0) -> SampleRecord:
    return SampleRecord(sequence, 1000 * sequence + run, (1, 2, 3, run), 0)


def take(log: FlashLog, until: int, run: int = 0) -> None:
    while log.next_sequence < until:
        log.append(record(log.next_sequence, run))


def test_regions_do_not_touch_each_other(fd: int) -> None:
    regions = [FlashRegion(fd, index, PAGES, PAGE_BYTES) for index in range(3)]
    logs = [FlashLog(region, 0, 0) for region in regions]
    for log in (logs[2], logs[0], logs[1]):
        take(log, 40, run=logs.index(log))
    for run, region in enumerate(regions):
        again = FlashLog(region, 0, 0)
        assert again.next_sequence == 40
        assert again.read(0, 99) == tuple(record(n, run) for n in range(again.oldest, 40))
    assert os.fstat(fd).st_size <= 3 * PAGES * PAGE_BYTES


def test_what_nobody_wrote_is_an_erased_flash(fd: int) -> None:
    region = FlashRegion(fd, 1, PAGES, PAGE_BYTES)
    region.roll_back(0)
    log = FlashLog(region, 0, 0)
    assert (log.next_sequence, log.torn, log.newest()) == (0, 0, None)
    assert os.fstat(fd).st_size == 0


@given(committed=st.integers(0, 40), lost=st.integers(1, A_PAGE), torn=st.integers(0, RECORD_BYTES - 1))
def test_what_an_unanswered_window_wrote_did_not_happen(committed: int, lost: int, torn: int) -> None:
    """Up to a page of records, and a torn one behind them, are undone without harm to any record that counted."""
    fd = os.memfd_create("flash")
    try:
        region = FlashRegion(fd, 0, PAGES, PAGE_BYTES)
        log = FlashLog(region, 0, 0)
        take(log, committed)
        before = log.read(0, 99)
        take(log, committed + lost, run=1)
        region.program(log.ring.address(log.next_sequence), record(log.next_sequence, 1).encode()[:torn])

        region.roll_back(committed)
        again = FlashLog(region, committed, 0)
        assert (again.next_sequence, again.torn) == (committed, 0)
        assert again.read(0, 99) == before
        take(again, committed + lost, run=2)
        assert again.read(committed, 99) == tuple(record(committed + n, 2) for n in range(lost))
    finally:
        os.close(fd)


def test_a_long_unanswered_window_leaves_nothing_of_itself(fd: int) -> None:
    region = FlashRegion(fd, 0, PAGES, PAGE_BYTES)
    log = FlashLog(region, 0, 0)
    take(log, 20)
    take(log, 34, run=1)
    region.roll_back(20)
    again = FlashLog(region, 20, 0)
    assert again.next_sequence == 20
    assert all(found.counts[3] == 0 for found in again.read(0, 99))
