"""The console's connections where this machine is so busy that a request waits unread: its sender is no silent stranger."""

from __future__ import annotations

import socket
import threading
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from typing import Any

import pytest
import uvicorn

from apad_bridge.console import process

PATIENCE_S = 180.0
REQUEST = b"GET / HTTP/1.1\r\nHost: here\r\nConnection: close\r\n\r\n"


async def app(scope: Any, receive: Any, send: Any) -> None:
    await send({"type": "http.response.start", "status": 200, "headers": [(b"content-length", b"4")]})
    await send({"type": "http.response.body", "body": b"done"})


@contextmanager
def served(most: int, strangers: int) -> Iterator[tuple[socket.socket, list[socket.socket]]]:
    """A person's link, whose request was sent, and the strangers' after it: all before the server runs at all."""
    with socket.create_server(("127.0.0.1", 0), backlog=64) as listener, ExitStack() as stack:
        person, *others = (
            stack.enter_context(socket.create_connection(listener.getsockname(), PATIENCE_S))
            for _ in range(1 + strangers)
        )
        person.sendall(REQUEST)
        config = uvicorn.Config(app, http=process.bounded(most), lifespan="off", log_level="warning")
        server = uvicorn.Server(config)
        serving = threading.Thread(target=server.run, kwargs={"sockets": [listener]})
        serving.start()
        try:
            yield person, others
        finally:
            server.should_exit = True
            serving.join(PATIENCE_S)


def said_to(link: socket.socket) -> bytes:
    with link.makefile("rb") as answer:
        try:
            return answer.read()
        except ConnectionResetError:
            return b""


def test_a_request_that_waits_unread_outlives_a_flood_after_it() -> None:
    with served(most=4, strangers=20) as (person, others):
        assert said_to(person).endswith(b"done")
        assert [said_to(it) for it in others[:-4]] == [b""] * 16


def test_a_request_that_waits_unread_is_answered_after_the_time_of_the_silent(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(process, "SILENT_S", 0.0)
    with served(most=4, strangers=1) as (person, (stranger,)):
        assert said_to(person).endswith(b"done")
        assert said_to(stranger) == b""
