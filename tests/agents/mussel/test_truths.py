"""Truths on their own channel: only whole windows count, and other datagrams are counted as dropped."""

from __future__ import annotations

import socket
from collections import Counter

import pytest

from agents.fleet_config import resting_on_bottom
from agents.hosting.link_protocol import LIMIT_BYTES, LinkError
from agents.mussel import truths
from agents.mussel.outputs import Truth
from firmware_model.states import State


def told(agent_id: int, count: int) -> list[Truth]:
    physical = resting_on_bottom(1.0, 2.0, 3.0, 0.5, 1.0)
    return [Truth(at_ms, agent_id, State.ACTIVE, physical) for at_ms in range(count)]


@pytest.mark.parametrize("count", [0, 1, 2000])
def test_truths_cross_in_as_many_datagrams_as_they_need(count: int) -> None:
    datagrams = truths.encode(7, (2, 9), told(7, count))
    assert all(len(datagram) <= LIMIT_BYTES for datagram in datagrams)
    messages = [truths.decode(datagram) for datagram in datagrams]
    assert all((message.agent_id, message.key) == (7, (2, 9)) for message in messages)
    assert [truth for message in messages for truth in message.truths] == told(7, count)


def test_what_is_no_telling_is_a_link_error() -> None:
    whole = truths.encode(7, (2, 9), told(7, 1))[0]
    wrong_state = bytearray(whole)
    wrong_state[14 + 10] = 200
    for data in (b"", whole[:-1], whole + b"x", bytes(wrong_state), truths.encode(8, (2, 9), told(7, 1))[0]):
        with pytest.raises(LinkError):
            truths.decode(data)


def test_a_hearer_keeps_answered_windows_and_counts_garbage() -> None:
    dropped: Counter[str] = Counter()
    hearing, message = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    with hearing, message:
        hearer = truths.TruthReceiver(hearing, dropped)
        for data in (
            b"no truth",
            b"",
            *truths.encode(7, (2, 1), told(7, 2)),
            *truths.encode(7, (2, 2), told(7, 3)),
        ):
            message.send(data)
        message.send(truths.encode(8, (2, 2), told(8, 1))[0])
        hearer.receive()
        assert hearer.take(7, (2, 1)) == tuple(told(7, 2))
        assert hearer.take(7, (2, 2)) == ()  # of an unanswered window, and so forgotten
        hearer.forget(8)
        assert hearer.take(8, (2, 2)) == ()
        assert dropped == {"truth: bytes that are no truths": 2}
        state = 14 + 10  # the datagram's head, and the stamp and the id of its truth
        for odd in range(200):
            wrong = bytearray(truths.encode(7, (2, 3), told(7, 1))[0])
            wrong[state] = 56 + odd
            message.send(bytes(15 + odd % 40))
            message.send(wrong)
            hearer.receive()
        assert dropped == {
            "truth: bytes that are no truths": 202,
            "truth: a truth with a value that cannot be": 200,
        }
        message.close()
        hearer.receive()  # the end is no garbage
        assert sum(dropped.values()) == 402
