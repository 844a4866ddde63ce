"""The physical file: the newest whole one of an agent's two records counts."""

from __future__ import annotations

import os
from collections.abc import Iterator

import pytest

from agents.fleet import resting_on_bottom
from agents.hosting.link_protocol import NEVER
from agents.mussel.physical import Physical
from agents.nursery.state_file import RECORD_BYTES, Record, RecordPair


def place(north_m: float) -> Physical:
    return resting_on_bottom(north_m, 0.0, 3.0, 0.5, 1.0)


@pytest.fixture
def file() -> Iterator[int]:
    descriptor = os.memfd_create("slots")
    yield descriptor
    os.close(descriptor)


def test_an_unanswered_windows_slot_does_not_count(file: int) -> None:
    pair = RecordPair(file, 1, 7)
    pair.initial_state(place(0))
    pair.write((1, 1), 10, place(1))
    pair.write((1, 2), 20, place(2))
    again = RecordPair(file, 1, 7)
    assert again.newest((1, 1)) == Record((1, 1), 10, place(1))
    assert again.newest((1, 2)) == Record((1, 2), 20, place(2))
    assert again.newest(None) == Record((1, 2), 20, place(2))


def test_a_restarted_agent_overwrites_what_did_not_count(file: int) -> None:
    pair = RecordPair(file, 0, 7)
    pair.initial_state(place(0))
    pair.write((1, 1), 10, place(1))
    pair.write((1, 2), 20, place(2))
    again = RecordPair(file, 0, 7)
    again.newest((1, 1))
    again.write((1, 3), 15, place(3))
    assert RecordPair(file, 0, 7).newest((1, 2)) == Record((1, 1), 10, place(1))
    assert RecordPair(file, 0, 7).newest(None) == Record((1, 3), 15, place(3))


@pytest.mark.parametrize("torn_at", [0, 5, 40, 90])
def test_a_torn_slot_gives_way_to_the_other(file: int, torn_at: int) -> None:
    pair = RecordPair(file, 0, 7)
    pair.initial_state(place(0))
    pair.write((1, 1), 10, place(1))
    byte = os.pread(file, 1, RECORD_BYTES + torn_at)[0]
    os.pwrite(file, bytes([byte ^ 0x40]), RECORD_BYTES + torn_at)
    assert RecordPair(file, 0, 7).newest(None) == Record(NEVER, 0, place(0))


def test_another_agents_slot_or_none_is_no_slot(file: int) -> None:
    RecordPair(file, 0, 7).initial_state(place(0))
    assert RecordPair(file, 0, 8).newest(None) is None
    assert RecordPair(file, 5, 7).newest(None) is None


def test_the_higher_epoch_is_the_newer_one(file: int) -> None:
    pair = RecordPair(file, 0, 7)
    pair.initial_state(place(0))
    pair.write((1, 900), 10, place(1))
    pair.write((2, 1), 20, place(2))
    assert RecordPair(file, 0, 7).newest(None) == Record((2, 1), 20, place(2))
