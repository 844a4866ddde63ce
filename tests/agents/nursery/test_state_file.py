"""The physical file: the newest whole one of an agent's records counts."""

from __future__ import annotations

import os
from collections.abc import Iterator
from typing import Any

import pytest

from agents.fleet_config import resting_on_bottom
from agents.hosting.link_protocol import NEVER
from agents.mussel.physical import Physical
from agents.nursery.state_file import RECORD_BYTES, RECORDS, RecordRing, StateRecord


def place(north_m: float) -> Physical:
    return resting_on_bottom(north_m, 0.0, 3.0, 0.5, 1.0)


@pytest.fixture
def file() -> Iterator[int]:
    descriptor = os.memfd_create("slots")
    yield descriptor
    os.close(descriptor)


@pytest.fixture
def ring(file: int) -> RecordRing:
    return RecordRing(file, 0, 7)


def test_an_unanswered_windows_slot_does_not_count_and_is_overwritten(ring: RecordRing, file: int) -> None:
    ring.initial_state(place(0))
    ring.write((1, 1), 10, place(1))
    ring.write((1, 2), 20, place(2))
    first, second, third = (StateRecord((1, n), at, place(n)) for n, at in ((1, 10), (2, 20), (3, 15)))
    again = RecordRing(file, 0, 7)
    assert [again.newest(key) for key in ((1, 2), None, (1, 1))] == [second, second, first]
    again.write((1, 3), 15, place(3))
    assert [RecordRing(file, 0, 7).newest(key) for key in ((1, 2), None)] == [first, third]


@pytest.mark.parametrize("torn_at", [0, 5, 40, 90])
def test_a_torn_slot_gives_way_to_the_other(ring: RecordRing, file: int, torn_at: int) -> None:
    ring.initial_state(place(0))
    ring.write((1, 1), 10, place(1))
    byte = os.pread(file, 1, RECORD_BYTES + torn_at)[0]
    os.pwrite(file, bytes([byte ^ 0x40]), RECORD_BYTES + torn_at)
    assert RecordRing(file, 0, 7).newest(None) == StateRecord(NEVER, 0, place(0))


def test_another_agents_slot_or_none_is_no_slot(file: int) -> None:
    RecordRing(file, 0, 7).initial_state(place(0))
    assert RecordRing(file, 0, 8).newest(None) is None
    assert RecordRing(file, 5, 7).newest(None) is None


FULL = [("write", (1, 4), 10 * n, place(n)) for n in range(1, RECORDS)]
WRITTEN: dict[str, tuple[list[tuple[Any, ...]], dict[tuple[Any, ...], StateRecord]]] = {
    "the higher epoch is the newer one": (
        [("write", (1, 900), 10, place(1)), ("write", (2, 1), 20, place(2))],
        {(None,): StateRecord((2, 1), 20, place(2))},
    ),
    "of windows with one key the newest up to a time counts": (
        FULL,
        {
            ((1, 4), 45): StateRecord((1, 4), 40, place(4)),
            ((1, 3), 45): StateRecord(NEVER, 0, place(0)),
            ((1, 4),): StateRecord((1, 4), 10 * (RECORDS - 1), place(RECORDS - 1)),
        },
    ),
    "windows that are taken back are overwritten, and no others": (
        [
            *FULL,
            ("take_back", RECORDS - 3),
            *(("write", (1, 5), 25 + n, place(100 + n)) for n in range(RECORDS - 3)),
        ],
        {
            ((1, 4),): StateRecord((1, 4), 20, place(2)),
            ((1, 5), 26): StateRecord((1, 5), 26, place(101)),
        },
    ),
}


@pytest.mark.parametrize(("acts", "newest"), WRITTEN.values(), ids=WRITTEN)
def test_the_newest_record(
    acts: list[tuple[Any, ...]], newest: dict[tuple[Any, ...], StateRecord], ring: RecordRing, file: int
) -> None:
    ring.initial_state(place(0))
    for name, *words in acts:
        getattr(ring, name)(*words)
    assert {up_to: RecordRing(file, 0, 7).newest(*up_to) for up_to in newest} == newest


def test_records_written_at_once_are_those_written_one_by_one(file: int) -> None:
    ring, other = RecordRing(file, 0, 7), RecordRing(file, 1, 7)
    states = [(10 * n, place(n)) for n in range(1, RECORDS + 5)]
    for each in (ring, other):
        each.initial_state(place(0))
    for granted_ms, physical in states:
        ring.write((1, 4), granted_ms, physical)
    other.write_all((1, 4), states[:5])
    other.write_all((1, 4), states[5:])
    ring_bytes = RECORDS * RECORD_BYTES
    assert os.pread(file, ring_bytes, 0) == os.pread(file, ring_bytes, ring_bytes)
    assert RecordRing(file, 1, 7).newest((1, 4), 45) is None  # overwritten, as the ring is full
    assert RecordRing(file, 1, 7).newest((1, 4), 55) == StateRecord((1, 4), 50, place(5))
