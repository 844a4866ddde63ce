"""Incoming connections of a node: silent, slow, broken and whole ones, and nobody waits for another."""

from __future__ import annotations

import io
import queue
import socket
import struct
import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack, suppress
from types import SimpleNamespace

import pytest
from rosgraph.network import ROSHandshakeException

from apad_bridge.ros.system.handshakes import LARGEST_BYTES, Handshakes, read_handshake

HANDSHAKE_S, PATIENCE_S = 0.4, 60.0
HEADER = b"\x08\x00\x00\x00topic=/a"
WHOLE = struct.pack("<I", len(HEADER)) + HEADER


@pytest.fixture
def handled() -> queue.Queue[bytes]:
    return queue.Queue()


@pytest.fixture
def clock() -> SimpleNamespace:
    """Stands still until a test moves it: so no handshake is too slow because this machine is."""
    return SimpleNamespace(now_s=0.0)


@pytest.fixture
def connect(handled: queue.Queue[bytes], clock: SimpleNamespace) -> Iterator[Callable[..., socket.socket]]:
    """Connects to a server that accepts as rospy does and reads what it is handed."""

    def handler(sock: socket.socket, _: object) -> None:
        # Blocks, as rospy's does, if the handshake is not whole.
        handled.put(sock.recv(len(WHOLE), socket.MSG_WAITALL))
        sock.close()

    handshakes = Handshakes(handler, HANDSHAKE_S, lambda: clock.now_s)

    def accept() -> None:
        with suppress(OSError):
            while True:
                handshakes.take(*listener.accept())

    with ExitStack() as stack:
        listener = stack.enter_context(socket.create_server(("127.0.0.1", 0)))
        threading.Thread(target=accept, daemon=True).start()

        def open_one(data: bytes = b"") -> socket.socket:
            sock = stack.enter_context(socket.create_connection(listener.getsockname(), PATIENCE_S))
            sock.sendall(data)
            return sock

        yield open_one


def was_closed(sock: socket.socket) -> bool:
    """True if the other end closes it in time, or resets it because something in it was not read."""
    with suppress(ConnectionResetError):
        return sock.recv(1) == b""
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


@pytest.mark.parametrize("header", [HEADER + b"x", b"\2\0\0\0=\xff"], ids=["cut short", "no text"])
def test_an_answer_that_is_no_handshake_is_one_failure(header: bytes) -> None:
    here, there = socket.socketpair()
    with here, there:
        here.settimeout(PATIENCE_S)
        there.sendall(struct.pack("<I", len(header)) + header)
        with pytest.raises(ROSHandshakeException):
            read_handshake(here, io.BytesIO())
