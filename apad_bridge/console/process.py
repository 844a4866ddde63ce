"""Serves the console of one run until it is told to end: a process of its own, so that no browser slows the supervisor."""

from __future__ import annotations

import asyncio
import os
import secrets
import socket
import threading
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import uvicorn
from uvicorn.protocols.http.h11_impl import H11Protocol

from agents.hosting.descriptors import raise_descriptor_limit
from agents.hosting.interrupts import received_by
from agents.hosting.link_protocol import readable
from apad_bridge.console.server import ConsoleEnding, app_of
from apad_bridge.records.run_directory import RunDirectory

TOKEN_VARIABLE = "MUSSELBED_CONSOLE_TOKEN"
"""The token of a console that is started again, for pages that are open. Only this user reads a process's variables."""
_BACKLOG = 32
"""asyncio accepts so many connections at once, before any of them can be closed."""
_MOST_CONNECTIONS = 256
"""An open page has one or two."""
_NICE = 5
"""Above the supervisor's: a page may wait for its processor, and a tick of the flight may not."""
SILENT_S = 5.0
"""A connection that has sent no whole request after so many wall seconds is closed."""


@dataclass(frozen=True, slots=True)
class ListenAddress:
    """The address to listen on; port 0 takes a free one."""

    host: str
    port: int
    names: tuple[str, ...] = ()
    """Further names by which browsers reach it, as that of a proxy."""


def serve(
    run_dir: Path,
    address: ListenAddress,
    tell: Callable[[str], None],
    ended: Callable[[str], None],
    warn: Callable[[str], None],
) -> None:
    """Serves until SIGINT or SIGTERM. `tell` takes the page's URL once the server listens, `ended` why the mission ended.

    `warn` takes lines for a person.

    RunDirectoryError when the directory holds no run that can be shown; OSError when the address cannot be used.
    """
    RunDirectory.created(run_dir)
    os.nice(_NICE)
    most = min(_MOST_CONNECTIONS, raise_descriptor_limit() // 4)
    token = os.environ.pop(TOKEN_VARIABLE, "") or secrets.token_urlsafe(16)
    asked_to_end = threading.Event()
    failures: list[Exception] = []
    with socket.create_server((address.host, address.port), backlog=_BACKLOG) as listener:
        host, port = listener.getsockname()[:2]
        tell(f"http://{host}:{port}/?token={token}")

        def end() -> None:
            asked_to_end.set()
            server.should_exit = True

        def fail(error: Exception) -> None:
            failures.append(error)
            end()

        config = uvicorn.Config(
            app_of(
                run_dir,
                token,
                ConsoleEnding(ended, asked_to_end.is_set, fail, warn),
                (address.host, *address.names),
            ),
            http=bounded(most),
            backlog=_BACKLOG,
            log_level="warning",
            lifespan="on",
            timeout_graceful_shutdown=2,
            access_log=False,
        )
        server = uvicorn.Server(config)
        # Beside the main thread uvicorn leaves the signals to us.
        serving = threading.Thread(target=server.run, kwargs={"sockets": [listener]}, name="console")
        with received_by(end):
            serving.start()
            serving.join()
    if failures:
        raise failures[0]


class _Bounded(H11Protocol):
    """Bounds the connections: strangers who only connect take no place from a person's stop."""

    most: int
    _closing: asyncio.TimerHandle

    @property
    def awaits_answer(self) -> bool:
        """True between a whole request and the end of its answer: the stream of an open page has no end."""
        return self.cycle is not None and not self.cycle.response_complete

    @property
    def has_unread(self) -> bool:
        """True when something came that a busy machine has not let this process read yet."""
        return readable(self.transport.get_extra_info("socket").fileno(), 0.0)

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        super().connection_made(transport)
        self._closing = self.loop.call_later(SILENT_S, self._close_silent)
        if len(self.connections) > self.most:
            # Their timers began with them: uvicorn keeps them without an order.
            others = [it for it in self.connections if isinstance(it, _Bounded) and not it.awaits_answer]
            others.sort(key=lambda it: it._closing.when())
            next((it for it in others if not it.has_unread), self).abort()

    def connection_lost(self, exc: Exception | None) -> None:
        self._closing.cancel()
        super().connection_lost(exc)

    def abort(self) -> None:
        self.connections.discard(self)
        self.transport.abort()

    def _close_silent(self) -> None:
        if self.cycle is not None:
            return
        if self.has_unread:
            self._closing = self.loop.call_later(SILENT_S, self._close_silent)
        else:
            self.abort()


def bounded(most: int) -> type[asyncio.Protocol]:
    """The protocol of a server with at most so many connections.

    With one more, the oldest of those that have sent nothing and await no answer is closed.
    """
    return type("Bounded", (_Bounded,), {"most": most})
