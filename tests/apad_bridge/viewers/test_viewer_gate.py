"""The door before the server for viewers, by real sockets."""

from __future__ import annotations

import socket
from collections.abc import Iterator
from contextlib import closing, suppress

import pytest

from apad_bridge.viewers.viewer_gate import ViewerGate, admits, hidden_address

TOKEN = "a-token"
PATIENCE_S = 60.0


def head(target: str, *fields: str) -> bytes:
    return "\r\n".join([f"GET {target} HTTP/1.1", "Host: 127.0.0.1:8765", *fields, "", ""]).encode()


@pytest.mark.parametrize(
    ("sent", "is_admitted"),
    [
        (head("/"), True),
        (head("/", "Origin: https://evil.org"), False),
        (head("/", "ORIGIN : null"), False),
        (head("/?token=guess", "Origin: https://evil.org"), False),
        (head("/?token=%C3%BC", "Origin: https://evil.org"), False),
        (head(f"/?token={TOKEN}", "Origin: https://viewer.org"), True),
        (head("/", f"X-Token: {TOKEN}", "origin: file://"), False),
    ],
)
def test_a_page_needs_the_token_and_a_program_does_not(sent: bytes, is_admitted: bool) -> None:
    assert admits(sent, TOKEN) is is_admitted


@pytest.fixture
def behind() -> Iterator[socket.socket]:
    with socket.create_server((hidden_address(), 0)) as listener:
        listener.settimeout(PATIENCE_S)
        yield listener


@pytest.fixture
def gate(behind: socket.socket) -> Iterator[ViewerGate]:
    with closing(ViewerGate("127.0.0.1", 0, TOKEN, behind.getsockname())) as opened:
        yield opened


def connected(gate: ViewerGate) -> socket.socket:
    return socket.create_connection(("127.0.0.1", gate.port), PATIENCE_S)


def test_bytes_of_an_admitted_connection_pass_both_ways(gate: ViewerGate, behind: socket.socket) -> None:
    with connected(gate) as viewer:
        viewer.sendall(head("/") + b"first")
        server, _ = behind.accept()
        with server, server.makefile("rb") as heard:
            assert heard.read(len(head("/")) + 5) == head("/") + b"first"
            server.sendall(b"answer")
            assert viewer.recv(6, socket.MSG_WAITALL) == b"answer"
            viewer.shutdown(socket.SHUT_WR)
            assert heard.read() == b""


def test_a_page_without_the_token_reaches_nothing(gate: ViewerGate, behind: socket.socket) -> None:
    with connected(gate) as page:
        page.sendall(head("/", "Origin: https://evil.org"))
        with page.makefile("rb") as answer:
            assert answer.read().startswith(b"HTTP/1.1 403 Forbidden")
    # The next connection that the server sees is another one.
    with connected(gate) as program:
        program.sendall(head("/second"))
        server, _ = behind.accept()
        with server:
            assert server.recv(11, socket.MSG_WAITALL) == b"GET /second"


def test_a_head_without_an_end_is_refused(gate: ViewerGate) -> None:
    with connected(gate) as stranger:
        stranger.sendall(b"x" * 20_000)
        with suppress(ConnectionResetError):  # some bytes were never read
            assert stranger.recv(1) == b""


def test_a_taken_address_is_told(gate: ViewerGate, behind: socket.socket) -> None:
    with pytest.raises(OSError, match="Address already in use"):
        ViewerGate("127.0.0.1", gate.port, TOKEN, behind.getsockname())
