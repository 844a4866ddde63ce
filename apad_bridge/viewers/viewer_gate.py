"""The door before the server for viewers: a page of the web needs the token, and a program of this machine does not.

foxglove-sdk takes every connection, and a browser lets any page open one to any address of the machine. So the server
listens at an address of the loopback network that nobody guesses, and this door at the known one. It reads the head of
each connection. A browser names the page there (`Origin`), which needs the token in the address; then all bytes pass.
"""

from __future__ import annotations

import asyncio
import hmac
import secrets
import socket
import threading
from contextlib import closing, suppress
from urllib.parse import parse_qs, urlsplit

TOKEN_VARIABLE = "MUSSELBED_FOXGLOVE_TOKEN"
"""The token of a server that is started again, for viewers that are open. Only this user reads a process's variables."""
_LONGEST_HEAD = 8192
_HEAD_S = 5.0
"""A connection that has sent no whole head after so many wall seconds is closed."""
_PIECE = 65_536
_MOST_WAITING = 64
_REFUSED = (
    b"HTTP/1.1 403 Forbidden\r\nContent-Type: text/plain\r\nConnection: close\r\n\r\n"
    b"a page needs the token: connect to the address that musselbed printed\n"
)


def hidden_address() -> str:
    """An address of 127.0.0.0/8, of 16 million: a page of the web that tries them needs days for one port."""
    return ".".join(["127", *(str(1 + secrets.randbelow(254)) for _ in range(3))])


def admits(head: bytes, token: str) -> bool:
    """True for the head of a request that no page of the web sent, or that has the token in its address."""
    lines = head.decode("latin-1").split("\r\n")
    fields = [it.partition(":")[0].strip().lower() for it in lines[1:]]
    if "origin" not in fields:
        return True
    _, _, rest = lines[0].partition(" ")
    target, _, _ = rest.partition(" ")
    given = parse_qs(urlsplit(target).query).get("token", [""])[0]
    return hmac.compare_digest(given.encode(), token.encode())


class ViewerGate:
    """Listens in a thread of its own, and passes admitted connections on to the server behind it."""

    def __init__(self, host: str, port: int, token: str, behind: tuple[str, int]) -> None:
        """`behind` is the server's address. OSError for an address that cannot be used."""
        self._listener = socket.create_server((host, port))
        self.port: int = self._listener.getsockname()[1]
        self._token = token
        self._waiting = 0
        self._behind = behind
        self._loop = asyncio.new_event_loop()
        self._is_closing = asyncio.Event()
        self._thread = threading.Thread(target=self._serve, name="viewers", daemon=True)
        self._thread.start()

    def close(self) -> None:
        self._loop.call_soon_threadsafe(self._is_closing.set)
        self._thread.join()

    def _serve(self) -> None:
        with closing(self._loop):
            self._loop.run_until_complete(self._serve_until_closing())

    async def _serve_until_closing(self) -> None:
        server = await asyncio.start_server(self._take, sock=self._listener, limit=_LONGEST_HEAD)
        await self._is_closing.wait()
        server.close()
        others = asyncio.all_tasks() - {asyncio.current_task()}
        for task in others:
            task.cancel()
        await asyncio.gather(*others, return_exceptions=True)

    async def _take(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        try:
            with suppress(OSError, EOFError, TimeoutError, asyncio.LimitOverrunError):
                if (head := await self._head(reader)) is None:
                    return
                if not admits(head, self._token):
                    writer.write(_REFUSED)
                    await writer.drain()
                    return
                await self._pass_on(head, reader, writer)
        finally:
            writer.close()

    async def _head(self, reader: asyncio.StreamReader) -> bytes | None:
        """The head of a connection; None where too many others wait with theirs."""
        if self._waiting >= _MOST_WAITING:
            return None
        self._waiting += 1
        try:
            return await asyncio.wait_for(reader.readuntil(b"\r\n\r\n"), _HEAD_S)
        finally:
            self._waiting -= 1

    async def _pass_on(self, head: bytes, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        answers, server = await asyncio.open_connection(*self._behind)
        try:
            server.write(head)
            ways = {
                asyncio.create_task(_copy(reader, server)),
                asyncio.create_task(_copy(answers, writer)),
            }
            await asyncio.wait(ways, return_when=asyncio.FIRST_COMPLETED)
            for way in ways:
                way.cancel()
            await asyncio.gather(*ways, return_exceptions=True)
        finally:
            server.close()


async def _copy(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
    """Until the end of either; a slow reader slows the other side down, whose server then drops the oldest."""
    while data := await reader.read(_PIECE):
        writer.write(data)
        await writer.drain()
