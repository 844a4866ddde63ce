"""Incoming connections of a node: silent, slow, broken and whole ones, and nobody waits for another."""

from __future__ import annotations

import queue
import socket
import struct
import threading
from collections.abc import Iterator

import pytest

from apad_bridge.ros.system.handshakes import LARGEST_BYTES, Handshakes

HANDSHAKE_S, PATIENCE_S = 0.4, 60.0
HEADER = b"\x08\x00\x00\x00topic=/a"
WHOLE = struct.pack("<I", len(HEADER)) + HEADER


@pytest.fixture
def handled() -> queue.Queue[bytes]:
    return queue.Queue()


class Clock:
    """Stands still until a test moves it: so no handshake is too slow because this machine is."""

    now_s = 0.0

    def __call__(self) -> float:
        return self.now_s


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture
def connect(handled: queue.Queue[bytes], clock: Clock) -> Iterator[object]:
    """Connects to a server that accepts as rospy does and reads what it is handed."""

    def handler(sock: socket.socket, _: object) -> None:
        # Blocks for ever, as rospy's does, if the handshake is not whole.
        data = b""
        while len(data) < len(WHOLE):
            data += sock.recv(4096)
        handled.put(data)
        sock.close()

    handshakes = Handshakes(handler, HANDSHAKE_S, clock)
    listener = socket.create_server(("127.0.0.1", 0))
    opened: list[socket.socket] = []

    def accept() -> None:
        while True:
            try:
                handshakes.take(*listener.accept())
            except OSError:
                return

    threading.Thread(target=accept, daemon=True).start()

    def open_one(data: bytes = b"") -> socket.socket:
        sock = socket.create_connection(listener.getsockname(), PATIENCE_S)
        opened.append(sock)
        sock.sendall(data)
        return sock

    yield open_one
    for sock in [*opened, listener]:
        sock.close()


def was_closed(sock: socket.socket) -> bool:
    """True if the other end closes it in time, or resets it because something in it was not read."""
    try:
        return sock.recv(1) == b""
    except ConnectionResetError:
        return True


def test_silent_and_torn_connections_keep_nobody_out_and_are_closed(connect, handled, clock) -> None:  # type: ignore[no-untyped-def]
    silent = [connect() for _ in range(50)] + [connect(WHOLE[:n]) for n in (1, 3, 4, 5, len(WHOLE) - 1)]
    connect(WHOLE)
    assert handled.get(timeout=PATIENCE_S) == WHOLE
    clock.now_s = HANDSHAKE_S
    assert all(was_closed(sock) for sock in silent)
    assert handled.empty()


def test_a_handshake_in_pieces_arrives_whole(connect, handled) -> None:  # type: ignore[no-untyped-def]
    sock = connect(WHOLE[:2])
    for byte in WHOLE[2:]:
        sock.sendall(bytes([byte]))
    assert handled.get(timeout=PATIENCE_S) == WHOLE


@pytest.mark.parametrize("length", [LARGEST_BYTES, 2**32 - 1])
def test_a_handshake_that_is_none_is_closed_at_once(connect, handled, length: int) -> None:  # type: ignore[no-untyped-def]
    assert was_closed(connect(struct.pack("<I", length) + b"GET / HTTP/1.1"))
    connect(WHOLE)
    assert handled.get(timeout=PATIENCE_S) == WHOLE


def test_one_that_leaves_before_it_said_a_word_disturbs_nobody(connect, handled) -> None:  # type: ignore[no-untyped-def]
    connect().close()
    connect(WHOLE[:6]).close()
    connect(WHOLE)
    assert handled.get(timeout=PATIENCE_S) == WHOLE
