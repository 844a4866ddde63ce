"""Answers lines through a Unix socket: a client connects, writes one line and reads one.

Each client has a thread, so a silent one delays nobody. A flood of silent ones takes neither the process's descriptors nor
the place of somebody who orders a stop: the oldest of them are left, and some descriptors are kept for this socket.
"""

from __future__ import annotations

import socket
import socketserver
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from typing import Any

from agents.hosting.descriptors import SHORT_OF_FILES, Reserve
from agents.hosting.link_protocol import readable
from apad_bridge.supervisor.control_protocol import LONGEST_LINE

CLIENT_S = 5.0
"""A client that writes nothing for so many wall seconds is left."""
_MOST_SILENT = 64
"""With one more client that has not written its line yet, the oldest of them is left."""
_AGAIN_S = 0.05
"""A server that can open no file waits so long before it tries to accept again."""


class LineServer(socketserver.ThreadingUnixStreamServer):
    """`answered` gives the answer to a line, in the client's thread; `admits` refuses a client without an answer."""

    request_queue_size = 128
    daemon_threads = True
    block_on_close = False

    def __init__(
        self, path: str, answered: Callable[[bytes], bytes], admits: Callable[[socket.socket], bool]
    ) -> None:
        """OSError for a path that cannot be used."""
        self.answered = answered
        self._admits = admits
        self._reserve = Reserve()
        self._silent: dict[socket.socket, None] = {}
        """The clients that have written no line yet, the oldest first."""
        self._lock = threading.Lock()
        super().__init__(path, _Handler)
        self._thread = threading.Thread(target=self.serve_forever, name="orders", daemon=True)
        self._thread.start()

    def get_request(self) -> tuple[Any, Any]:
        """Accepts a connection, by a descriptor of the reserve where no other is left."""
        try:
            return super().get_request()
        except OSError as error:
            if error.errno in SHORT_OF_FILES and self._reserve.give_up_one():
                return super().get_request()
            time.sleep(_AGAIN_S)  # socketserver would try again at once, for as long as this lasts
            raise

    def verify_request(self, request: Any, client_address: Any) -> bool:
        return self._admits(request)

    def process_request(self, request: Any, client_address: Any) -> None:
        with self._lock:
            self._silent[request] = None
            # A line may wait for its thread, which has no processor yet: its client is not silent.
            silent = (it for it in self._silent if not readable(it.fileno(), 0.0))
            if len(self._silent) > _MOST_SILENT and (oldest := next(silent, None)) is not None:
                del self._silent[oldest]
                with suppress(OSError):
                    oldest.shutdown(socket.SHUT_RDWR)  # its thread then closes it
        super().process_request(request, client_address)

    def read_line(self, client: socket.socket) -> bytes:
        """The client's line, at most `LONGEST_LINE` long; empty for one that wrote none in `CLIENT_S`, or has left."""
        line, is_whole, end_s = b"", False, time.monotonic() + CLIENT_S
        while not is_whole and readable(client.fileno(), max(0.0, end_s - time.monotonic())):
            # Whoever looks for silent clients finds the line unread, or its client gone from among them.
            with self._lock:
                data = client.recv(LONGEST_LINE - len(line), socket.MSG_DONTWAIT)
                line += data
                is_whole = not data or b"\n" in data or len(line) == LONGEST_LINE
                if is_whole:
                    self._silent.pop(client, None)
        head, newline, _ = line.partition(b"\n")
        return head + newline if is_whole else b""

    def shutdown_request(self, request: Any) -> None:
        """Closes a client's link, also where no thread could begin for it."""
        with self._lock:
            self._silent.pop(request, None)
        super().shutdown_request(request)

    def service_actions(self) -> None:
        """Called after each connection, and at least twice a second: by then the connections before may have ended."""
        self._reserve.refill()

    def close(self) -> None:
        self.shutdown()
        self.server_close()
        self._reserve.close()


class _Handler(socketserver.BaseRequestHandler):
    server: LineServer

    def handle(self) -> None:
        with suppress(OSError):  # the client left: its order stands
            line = self.server.read_line(self.request)
            if line:  # without one it looked whether anybody listens
                self.request.settimeout(CLIENT_S)
                self.request.sendall(self.server.answered(line) + b"\n")
