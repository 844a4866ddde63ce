"""The socket for orders on a machine so busy that a line waits for its thread: its sender is no silent stranger."""

from __future__ import annotations

import socket
import threading
from contextlib import ExitStack
from pathlib import Path

import pytest

from apad_bridge.supervisor import line_server
from apad_bridge.supervisor.line_server import LineServer

PATIENCE_S = 180.0


def test_a_line_that_waits_for_its_thread_outlives_a_flood_after_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    flooded = threading.Event()
    setup = line_server._Handler.setup

    def late(self: line_server._Handler) -> None:
        flooded.wait(PATIENCE_S)
        setup(self)

    monkeypatch.setattr(line_server._Handler, "setup", late)
    monkeypatch.setattr(line_server, "_MOST_SILENT", 4)
    accepted = threading.Semaphore(0)

    def admits(_: socket.socket) -> bool:
        accepted.release()
        return True

    path = str(tmp_path / "orders")
    server = LineServer(path, bytes.upper, admits)
    with ExitStack() as stack:
        stack.callback(server.close)
        links = [stack.enter_context(socket.socket(socket.AF_UNIX)) for _ in range(21)]
        for link in links:
            link.settimeout(PATIENCE_S)
            link.connect(path)
            if link is links[0]:
                link.sendall(b"stop\n")
            assert accepted.acquire(timeout=PATIENCE_S)
        # The one that is accepted last is looked at when the next one is.
        flooded.set()
        assert links[0].makefile("rb").readline() == b"STOP\n"
        assert [it.recv(1) for it in links[1:-5]] == [b""] * 15
