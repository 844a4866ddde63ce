"""The control link's words, and descriptors that travel with them."""

from __future__ import annotations

import os
import socket
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from agents import control
from agents.link import LIMIT_BYTES, LinkError

MESSAGES: list[control.Message] = [
    control.Hello(3),
    control.Start(1, ((7, 30_000, 1, 2, 3), (8, 0, 0, 0, 0))),
    control.Kill(2, 7),
    control.End(),
    control.Welcome(4711, 2),
    control.Roll(((7, 0, 1, 2, 30_000),)),
    control.Started(1, ((7, 4712),)),
    control.Killed(2, 7),
    control.Ended(),
    control.Died(7, 4712, "killed by SIGKILL"),
    control.Refused(1, 9, False, "aMussel 9 is not of this fleet"),
]


@pytest.mark.parametrize("message", MESSAGES, ids=lambda message: type(message).__name__)
def test_each_message_crosses(message: control.Message) -> None:
    assert control.decode(control.encode(message)) == message


@given(data=st.binary(max_size=40))
def test_garbage_is_a_link_error(data: bytes) -> None:
    try:
        control.decode(data)
    except LinkError:
        return


@pytest.mark.parametrize("message", MESSAGES, ids=lambda message: type(message).__name__)
def test_a_truncated_message_is_a_link_error(message: control.Message) -> None:
    data = control.encode(message)
    for size in range(len(data)):
        with pytest.raises(LinkError):
            control.decode(data[:size])


def test_descriptors_arrive_with_their_message_and_are_closed_with_a_bad_one() -> None:
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    reading, writing = os.pipe()
    with ours, theirs:
        control.send(ours, control.Welcome(1, 0), [reading])
        message, descriptors = control.receive(theirs) or (None, [])
        assert message == control.Welcome(1, 0)
        os.write(writing, b"x")
        assert os.read(descriptors[0], 1) == b"x"
        os.close(descriptors[0])
        socket.send_fds(ours, [b"garbage"], [writing])
        os.close(writing)
        with pytest.raises(LinkError):
            control.receive(theirs)
        assert os.read(reading, 1) == b""  # the last writing end is closed
        ours.send(bytes(LIMIT_BYTES + 1))
        with pytest.raises(LinkError, match="longer than 65536"):
            control.receive(theirs)
        control.send(ours, control.End())
        assert control.receive(theirs) == (control.End(), [])
    os.close(reading)


def test_a_run_directory_may_be_longer_than_a_sockets_path(tmp_path: Path) -> None:
    deep = tmp_path / ("d" * 120)
    deep.mkdir()
    with control.listen(str(deep)) as listener, control.connect(str(deep), 5.0) as ours:
        theirs, _ = listener.accept()
        with theirs:
            control.send(ours, control.Hello(1))
            assert control.receive(theirs) == (control.Hello(1), [])
    with control.listen(str(deep)), pytest.raises(FileNotFoundError):
        control.connect(str(tmp_path), 5.0)
