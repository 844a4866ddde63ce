"""A program that gives every XML-RPC call the same answer, however wrong."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from threading import Thread
from typing import Any
from xmlrpc.client import dumps

CUT_SHORT = b"<?xml version='1.0'?><methodRes"


def whole(value: Any) -> bytes:
    """The bytes of an answer with a value of any kind."""
    return dumps((value,), methodresponse=True).encode()


@contextmanager
def answering_with(answer: bytes) -> Iterator[str]:
    """Gives the URI."""

    class Answering(BaseHTTPRequestHandler):
        def do_POST(self) -> None:
            self.rfile.read(int(self.headers["Content-Length"]))
            self.send_response(200)
            self.end_headers()
            self.wfile.write(answer)

        def log_message(self, *_: Any) -> None:
            """Nobody reads it."""

    with ThreadingHTTPServer(("127.0.0.1", 0), Answering) as server:
        Thread(target=server.serve_forever, args=(0.02,), daemon=True).start()
        try:
            yield f"http://127.0.0.1:{server.server_port}"
        finally:
            server.shutdown()
