"""Truths on the fleet's one truth socket. A datagram names its agent and window, so that a window commits whole."""

from __future__ import annotations

import socket
import struct
from collections import Counter
from dataclasses import dataclass

from agents.hosting.link_protocol import LIMIT_BYTES, Key, LinkError, hung_up
from agents.mussel.outputs import TRUTH_BYTES, Truth, unpack_truths

_HEAD = struct.Struct("<HIQ")
_AT_ONCE = (LIMIT_BYTES - _HEAD.size) // TRUTH_BYTES


@dataclass(frozen=True, slots=True)
class TruthMessage:
    """Truths of one agent in the window `key`, in order."""

    agent_id: int
    key: Key
    truths: tuple[Truth, ...]


def encode(agent_id: int, key: Key, truths: list[Truth]) -> list[bytes]:
    """The datagrams that carry `truths`, in order; none if there are no truths."""
    head = _HEAD.pack(agent_id, *key)
    return [
        head + b"".join([truth.pack() for truth in truths[start : start + _AT_ONCE]])
        for start in range(0, len(truths), _AT_ONCE)
    ]


def decode(data: bytes | memoryview) -> TruthMessage:
    """The inverse of `encode`, for one datagram; LinkError for other bytes."""
    if len(data) > LIMIT_BYTES or len(data) < _HEAD.size:
        raise LinkError("bytes that are no truths")
    agent_id, epoch, sequence = _HEAD.unpack_from(data)
    try:
        truths = unpack_truths(data[_HEAD.size :])
    except ValueError as error:
        raise LinkError(str(error)) from None
    if any(truth.agent_id != agent_id for truth in truths):
        raise LinkError("a truth of another agent")
    return TruthMessage(agent_id, (epoch, sequence), truths)


class TruthReceiver:
    """The reading end. It counts other datagrams in `dropped`."""

    def __init__(self, sock: socket.socket, dropped: Counter[str]) -> None:
        self._sock = sock
        self._dropped = dropped
        self._buffer = memoryview(bytearray(LIMIT_BYTES + 1))
        self._messages: dict[int, list[TruthMessage]] = {}

    def receive(self) -> None:
        """Reads all waiting datagrams. An agent sends its truths before it answers."""
        while True:
            try:
                size = self._sock.recv_into(self._buffer, 0, socket.MSG_DONTWAIT)
            except BlockingIOError:
                return
            if size == 0 and hung_up(self._sock):
                return
            try:
                message = decode(self._buffer[:size])
            except LinkError as error:
                self._dropped[f"truth: {error}"] += 1
                continue
            self._messages.setdefault(message.agent_id, []).append(message)

    def take(self, agent_id: int, up_to: Key) -> tuple[Truth, ...]:
        """An agent's truths up to an answered window, in order; the receiver forgets its others."""
        messages = self._messages.pop(agent_id, [])
        return tuple([truth for message in messages for truth in message.truths if message.key <= up_to])

    def forget(self, agent_id: int) -> None:
        """Forgets the truths of an unanswered window, which did not happen."""
        self._messages.pop(agent_id, None)
