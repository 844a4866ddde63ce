"""A publisher's connections: whole messages in order, no waiting, and stalled readers are disconnected."""

from __future__ import annotations

import socket
import struct
from collections.abc import Iterator
from contextlib import nullcontext, suppress
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rospy.exceptions import TransportTerminated

from apad_bridge.ros.gateway.never_blocking import STALLED_S, NeverBlocking, Stalls

READER = "/reader"


class Connection:
    """The part of rospy's transport that a NeverBlocking uses, on a real socket."""

    endpoint_id = READER
    done = False
    stat_num_msg = stat_bytes = 0

    def __init__(self, sock: Any) -> None:
        self.socket = sock


class Chokes:
    """A socket that takes the given number of bytes at each send; 0 is a full buffer."""

    def __init__(self, takes: list[int]) -> None:
        self._takes = iter(takes)
        self.received = b""

    def setblocking(self, blocking: bool) -> None:
        assert not blocking

    def send(self, data: bytes) -> int:
        taken = min(len(data), next(self._takes, len(data)))
        if taken == 0:
            raise BlockingIOError
        self.received += data[:taken]
        return taken


def message(number: int, length: int) -> bytes:
    return struct.pack("<II", 4 + length, number) + bytes(length)


def numbers(stream: bytes) -> Iterator[int]:
    """The numbers of the whole messages in the stream. The last message may still be incomplete."""
    while len(stream) >= 8:
        length, number = struct.unpack_from("<II", stream)
        if len(stream) < 4 + length:
            return
        yield number
        stream = stream[4 + length :]


@given(
    lengths=st.lists(st.integers(0, 40), min_size=1, max_size=30),
    takes=st.lists(st.integers(0, 30), max_size=40),
)
def test_each_message_comes_whole_and_in_order_or_is_counted_as_left_out(
    lengths: list[int], takes: list[int]
) -> None:
    stalls, choking = Stalls(), Chokes(takes)
    connection = NeverBlocking(Connection(choking), stalls, now_s=lambda: 0.0)
    for number, length in enumerate(lengths):
        connection.write_data(message(number, length))
    connection.write_data(message(len(lengths), 0))
    arrived = list(numbers(choking.received))
    assert arrived == sorted(set(arrived))
    under_way = len(choking.received) > sum(4 + 4 + [*lengths, 0][n] for n in arrived)
    assert len(arrived) + under_way + stalls.left_out[READER] == len(lengths) + 1


@pytest.mark.parametrize("reads", [False, True], ids=["takes nothing", "reads again in time"])
def test_a_reader_that_takes_nothing_for_the_stated_time_is_disconnected_and_counted(reads: bool) -> None:
    ours, theirs = socket.socketpair()
    with ours, theirs:
        now_s, stalls = 0.0, Stalls()
        connection = NeverBlocking(Connection(ours), stalls, now_s=lambda: now_s)
        while not stalls.left_out:
            connection.write_data(message(1, 1000))
        now_s = STALLED_S - 0.01
        theirs.setblocking(False)
        with suppress(BlockingIOError):
            while reads and theirs.recv(65536):
                pass
        connection.write_data(message(2, 1000))
        now_s = 2 * STALLED_S if reads else STALLED_S
        with nullcontext() if reads else pytest.raises(TransportTerminated):
            connection.write_data(message(3, 1000))
        assert stalls.disconnected == ({} if reads else {READER: 1})
        assert reads or stalls.longest_s == STALLED_S


def test_a_reader_that_has_gone_ends_the_connection() -> None:
    ours, theirs = socket.socketpair()
    with ours:
        connection = NeverBlocking(Connection(ours), Stalls())
        theirs.close()
        with pytest.raises(TransportTerminated):
            connection.write_data(message(1, 10))
