"""The console's web server: the replay page with live data, and a person's orders.

Every request needs the console's token. It is no cookie, which a browser would send to every port of the host: the page
keeps it for its own origin and sends it with each request. An order needs it in a header, which no page of another origin
can add. A request names the console by an address or by a name of this machine, because a stranger's name service can
lead a page of his to any address.
Orders go to the supervisor as those of the commands do (`supervisor/control_server.py`), so the same rules refuse them.
"""

from __future__ import annotations

import asyncio
import hmac
import json
import re
import socket
from collections.abc import AsyncIterator, Callable, Collection
from contextlib import asynccontextmanager, suppress
from dataclasses import asdict, dataclass
from ipaddress import ip_address
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from pydantic import TypeAdapter, ValidationError
from starlette.applications import Starlette
from starlette.middleware import Middleware
from starlette.requests import Request
from starlette.responses import (
    HTMLResponse,
    JSONResponse,
    PlainTextResponse,
    Response,
    StreamingResponse,
)
from starlette.routing import Route
from starlette.types import ASGIApp, Receive, Scope, Send

from apad_bridge.analysis.replay.build import render
from apad_bridge.analysis.replay.series import Counts
from apad_bridge.console.feed import Feed
from apad_bridge.records.journal import await_beginning
from apad_bridge.records.run_directory import RunDirectory
from apad_bridge.supervisor import control_server
from apad_bridge.supervisor.control_protocol import LONGEST_LINE, answer_of

_POLL_S = 0.25
_BEAT_S = 1.0
"""A page that hears nothing for three beats says so."""
_WAITING = 40
"""A page that leaves so many messages unread is left; its browser connects again."""
_BEGUN_S = 10.0
"""A page waits so long for the flight to begin and its journal to be read, and then says so."""
_ORDER = TypeAdapter[control_server.AnyRequest](control_server.AnyRequest)
_NEEDS_TOKEN = "This console needs its token: open the address that `musselbed console` printed."
_REFUSED = PlainTextResponse(f"{_NEEDS_TOKEN}\n", status_code=403)
_ANOTHER_HOST = PlainTextResponse(
    "This console is not at that name: use its address, or start it with --name NAME\n", status_code=403
)
_TOKEN_HEADER = "X-Musselbed-Token"
_PRIVATE = {"Cache-Control": "no-store", "Referrer-Policy": "no-referrer", "X-Frame-Options": "DENY"}
"""The headers of pages: no other page gets the address with the token, nor shows this one in a frame."""
_ASKED_AGAIN = HTMLResponse(
    f"""<!doctype html><html lang="en"><meta name="viewport" content="width=device-width">
<meta name="color-scheme" content="light dark"><title>musselbed</title><p>{_NEEDS_TOKEN}</p><script>
const token = sessionStorage.getItem("token");
sessionStorage.removeItem("token");  // a wrong one is tried once
if (token) location.replace("/?token=" + encodeURIComponent(token) + location.hash);
</script>""",
    status_code=403,
    headers=_PRIVATE,
)
"""A tab that is loaded again has its token still."""

_NOT_BEGUN = HTMLResponse(
    """<!doctype html><html lang="en"><meta charset="utf-8"><meta name="viewport" content="width=device-width">
<title>musselbed - before the flight</title>
<style>
:root { color-scheme: light dark; }
body { margin: 18vh auto; max-width: 30rem; padding: 0 1rem; font: 16px/1.5 system-ui, "DejaVu Sans", sans-serif; }
</style>
<h1>The flight has not begun yet</h1>
<p>The simulated aMussels and the aPad are starting, or the run's records are being read.
This page opens the flight as soon as it can; that takes some seconds.</p>""",
    headers={"Refresh": "1"},
)
"""`Refresh` has the browser ask again after a second."""


@dataclass(frozen=True, slots=True)
class ConsoleEnding:
    """The ways in which a console and its run end."""

    run_ended: Callable[[str], None]
    """Takes why the mission ended, once, after the pages have the run's summary."""
    is_asked_to_end: Callable[[], bool]
    """True when the console itself is to end: the streams to its pages then end."""
    failed: Callable[[Exception], None]
    """Takes what ended the polling, a run that cannot be shown or a defect of ours: the pages would stand still untold."""
    tell: Callable[[str], None] = lambda text: None
    """Takes a line for a person."""


class Broadcast:
    """Sends what the feed gives to every open page, encoded once."""

    def __init__(self, feed: Feed, ending: ConsoleEnding) -> None:
        self._feed = feed
        self._ending = ending
        self._has_sent_end = False
        self._pages: set[asyncio.Queue[bytes | None]] = set()
        self._lock = asyncio.Lock()

    async def run(self) -> None:
        """Polls until the console is asked to end, or fails; the pages' streams end with it."""
        try:
            await self._poll()
        except Exception as error:
            self._ending.failed(error)
        for queue in self._pages:
            queue.put_nowait(None)

    async def _poll(self) -> None:
        sent, sent_s = b"", 0.0
        loop = asyncio.get_running_loop()
        while not self._ending.is_asked_to_end():
            async with self._lock:
                message = await asyncio.to_thread(self._feed.poll)
                data = _encoded(message)
                if message["sample"] is not None or data != sent or loop.time() - sent_s >= _BEAT_S:
                    sent, sent_s = data, loop.time()
                    self._send(data)
            if message["summary"] is not None and not self._has_sent_end:
                self._has_sent_end = True
                self._ending.run_ended(message["ended_by"])
            await asyncio.sleep(_POLL_S)

    async def page(self) -> str:
        """The page with the run so far."""
        async with self._lock:
            return await asyncio.to_thread(lambda: render([self._feed.page_data()]))

    async def stream(self, counts: Counts) -> AsyncIterator[bytes]:
        """Yields what a page with so much lacks, and then all that is new."""
        queue: asyncio.Queue[bytes | None] = asyncio.Queue()
        async with self._lock:
            queue.put_nowait(_encoded(self._feed.since(counts)))
            self._pages.add(queue)
        try:
            while (data := await queue.get()) is not None:
                yield data
        finally:
            self._leave(queue)

    def _leave(self, queue: asyncio.Queue[bytes | None]) -> None:
        self._pages.discard(queue)

    def _send(self, data: bytes) -> None:
        for queue in list(self._pages):
            if queue.qsize() >= _WAITING:
                self._leave(queue)
                queue.put_nowait(None)
            else:
                queue.put_nowait(data)


def _encoded(message: dict[str, Any]) -> bytes:
    """A server-sent event (HTML standard, 9.2)."""
    return b"data: " + json.dumps(message, separators=(",", ":"), allow_nan=False).encode() + b"\n\n"


def order_line(url: str) -> str:
    """A line for a shell that gives an order as a program does, at the page of this URL."""
    page, _, token = url.partition("/?token=")
    order = '{"act": "stop", "by": "NAME"}'
    return f"curl -H '{_TOKEN_HEADER}: {token}' -H 'Origin: {page}' -d '{order}' {page}/orders"


def app_of(run_dir: Path, token: str, ending: ConsoleEnding, names: Collection[str] = ()) -> Starlette:
    """The console of a run. Its pages say that the flight has not begun until it has.

    `names` are further names of this machine's, as of a proxy before the console.
    """
    pages = _Pages(run_dir, token)

    async def follow() -> None:
        try:
            begun = await asyncio.to_thread(
                await_beginning, RunDirectory(run_dir), ending.is_asked_to_end, ending.tell
            )
            if not begun:
                return
            feed = await asyncio.to_thread(Feed, run_dir)
        except Exception as error:
            ending.failed(error)
            return
        try:
            broadcast = Broadcast(feed, ending)
            pages.broadcast.set_result(broadcast)
            await broadcast.run()
        finally:
            feed.close()

    @asynccontextmanager
    async def lifespan(_: Starlette) -> AsyncIterator[None]:
        pages.broadcast = asyncio.get_running_loop().create_future()
        polling = asyncio.create_task(follow())
        try:
            yield
        finally:
            polling.cancel()

    return Starlette(
        routes=[
            Route("/", pages.page),
            Route("/favicon.ico", pages.icon),
            Route("/live", pages.live),
            Route("/orders", pages.order, methods=["POST"]),
        ],
        middleware=[Middleware(_OwnHost, names=frozenset(names) | names_of_this_machine())],
        lifespan=lifespan,
    )


def names_of_this_machine() -> frozenset[str]:
    name = socket.gethostname().lower()
    return frozenset({"localhost", name, f"{name}.local"})


def is_own_host(host: str, names: Collection[str]) -> bool:
    """True for a Host header with an address, or with one of these names, and any port."""
    try:
        name = urlsplit(f"//{host}").hostname or ""
    except ValueError:
        return False
    if name in names:
        return True
    try:
        ip_address(name)
    except ValueError:
        return False
    return True


class _OwnHost:
    """Refuses requests for another host."""

    def __init__(self, app: ASGIApp, names: Collection[str]) -> None:
        self._app = app
        self._names = names

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] == "http" and not is_own_host(Request(scope).headers.get("host", ""), self._names):
            await _ANOTHER_HOST(scope, receive, send)
        else:
            await self._app(scope, receive, send)


class _Pages:
    """Answers requests; one without the token gets nothing."""

    def __init__(self, run_dir: Path, token: str) -> None:
        self._run_dir = run_dir
        self._token = token
        self.broadcast: asyncio.Future[Broadcast]
        """Made when the server starts; done when the flight has begun and its journal so far is read."""

    async def page(self, request: Request) -> Response:
        if not self._is_token(request.query_params.get("token", "")):
            return _ASKED_AGAIN
        broadcast = await self._begun()
        return _NOT_BEGUN if broadcast is None else HTMLResponse(await broadcast.page(), headers=_PRIVATE)

    async def live(self, request: Request) -> Response:
        if not self._is_token(request.query_params.get("token", "")):
            return _REFUSED
        if (broadcast := await self._begun()) is None:
            return _NOT_BEGUN
        try:
            trace, events, plans, packets, measured = map(int, request.query_params["counts"].split(","))
        except (KeyError, ValueError):
            return PlainTextResponse("counts are five numbers\n", status_code=400)
        counts = trace, events, plans, packets, measured
        return StreamingResponse(
            broadcast.stream(counts),
            media_type="text/event-stream",
            headers={"Cache-Control": "no-store"},
        )

    async def order(self, request: Request) -> Response:
        if not self._is_token(request.headers.get(_TOKEN_HEADER, "")):
            return _REFUSED
        if not _is_of_this_origin(request):
            return PlainTextResponse("orders are taken from this console's own page\n", status_code=403)
        length = request.headers.get("content-length", "")
        # The digits before the number: a text of five thousand is no integer to Python.
        if not (re.fullmatch("[0-9]{1,9}", length) and 0 < int(length) <= LONGEST_LINE):
            return PlainTextResponse("an order is one short line of JSON, with its length\n", status_code=400)
        try:
            asked = _ORDER.validate_json(await request.body())
        except ValidationError as error:
            return JSONResponse({"accepted": False, "message": _mistake(error)}, status_code=400)
        answer = await asyncio.to_thread(answer_of, self._run_dir, asked)
        return JSONResponse(asdict(answer))

    async def icon(self, request: Request) -> Response:
        """Browsers ask for one; there is none."""
        return Response(status_code=204)

    async def _begun(self) -> Broadcast | None:
        """None for a flight that has not begun, or whose journal is not read yet, after some time."""
        with suppress(TimeoutError):
            return await asyncio.wait_for(asyncio.shield(self.broadcast), _BEGUN_S)
        return None

    def _is_token(self, text: str) -> bool:
        # As bytes: the comparison takes no text beyond ASCII.
        return hmac.compare_digest(text.encode(), self._token.encode())


def _mistake(error: ValidationError) -> str:
    """The first mistake in an order, with its key."""
    first = error.errors()[0]
    return ": ".join([*map(str, first["loc"][-1:]), first["msg"]])


def _is_of_this_origin(request: Request) -> bool:
    """Browsers name the page that asks: its origin with every POST, and to trusted addresses its relation to ours."""
    host = request.headers.get("host", "")
    is_ours = request.headers.get("origin") in (f"http://{host}", f"https://{host}")
    return is_ours and request.headers.get("sec-fetch-site", "same-origin") == "same-origin"
