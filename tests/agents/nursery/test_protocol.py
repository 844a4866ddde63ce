"""The control link's messages, and the descriptors that travel with them."""

from __future__ import annotations

import os
import socket
from pathlib import Path

import msgpack
import pytest
from hypothesis import given
from hypothesis import strategies as st

from agents.hosting.link_protocol import LIMIT_BYTES, LinkError
from agents.nursery import protocol

MESSAGES: list[protocol.NurseryMessage] = [
    protocol.Hello(3),
    protocol.StartAgents(1, ((7, 30_000, 1, 2, 3), (8, 0, 0, 0, 0))),
    protocol.Kill(2, 7),
    protocol.End(),
    protocol.Welcome(4711, 2),
    protocol.ChildList(((7, 0, 1, 2, 30_000),)),
    protocol.Started(1, ((7, 4712),)),
    protocol.Killed(2, 7),
    protocol.NurseryEnded(),
    protocol.Died(7, 4712, "killed by SIGKILL"),
    protocol.StartRefused(1, 9, False, "aMussel 9 is not of this fleet"),
]


@pytest.mark.parametrize("message", MESSAGES, ids=lambda message: type(message).__name__)
def test_each_message_crosses_whole_or_not_at_all(message: protocol.NurseryMessage) -> None:
    data = protocol.encode(message)
    assert protocol.decode(data) == message
    for size in range(len(data)):
        with pytest.raises(LinkError):
            protocol.decode(data[:size])


@given(data=st.binary(max_size=40))
def test_garbage_is_a_link_error(data: bytes) -> None:
    try:
        protocol.decode(data)
    except LinkError:
        return


WRONG_ROWS = [[None], [[]], [[1] * 8], *([[wrong] * width] for wrong in (-1, True) for width in (2, 5))]
WRONG = [None, True, -1, 0.5, "word", b"bytes", {}, *WRONG_ROWS]
"""No field may hold any of these, but that one is a word and one is true or false; no row has eight numbers."""


@pytest.mark.parametrize("message", MESSAGES, ids=lambda message: type(message).__name__)
def test_a_wrong_field_is_a_link_error(message: protocol.NurseryMessage) -> None:
    """Bytes at random are hardly ever msgpack: these differ from a message in one field, or in how many there are."""
    right = msgpack.unpackb(protocol.encode(message))
    wires = [right[:-1], [*right, 0]]
    for at, field in enumerate(right):
        wires += [
            [*right[:at], wrong, *right[at + 1 :]]
            for wrong in WRONG
            if type(wrong) is not type(field) or not isinstance(field, bool | str)
        ]
    for wire in wires:
        with pytest.raises(LinkError):
            protocol.decode(msgpack.packb(wire))


def test_descriptors_arrive_with_their_message_and_are_closed_with_a_bad_one() -> None:
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    reading, writing = os.pipe()
    with ours, theirs:
        protocol.send(ours, protocol.Welcome(1, 0), [reading])
        message, descriptors = protocol.receive(theirs) or (None, [])
        assert message == protocol.Welcome(1, 0)
        os.write(writing, b"x")
        assert os.read(descriptors[0], 1) == b"x"
        os.close(descriptors[0])
        socket.send_fds(ours, [b"garbage"], [writing])
        os.close(writing)
        with pytest.raises(LinkError):
            protocol.receive(theirs)
        assert os.read(reading, 1) == b""  # the last writing end is closed
        ours.send(bytes(LIMIT_BYTES + 1))
        with pytest.raises(LinkError, match="longer than 65536"):
            protocol.receive(theirs)
        protocol.send(ours, protocol.End())
        assert protocol.receive(theirs) == (protocol.End(), [])
    os.close(reading)


def test_a_run_directory_may_be_longer_than_a_sockets_path(tmp_path: Path) -> None:
    deep = tmp_path / ("d" * 120)
    deep.mkdir()
    with protocol.listen(str(deep)) as listener, protocol.connect(str(deep), 5.0) as ours:
        theirs, _ = listener.accept()
        with theirs:
            protocol.send(ours, protocol.Hello(1))
            assert protocol.receive(theirs) == (protocol.Hello(1), [])
    with protocol.listen(str(deep)), pytest.raises(FileNotFoundError):
        protocol.connect(str(tmp_path), 5.0)
