"""A copy of a run that flies on another machine, in a private folder that lasts as long as the console.

It has what a console reads, and grows as the run does. Its control socket passes orders on, so everything that takes a
run's directory takes this one.
"""

from __future__ import annotations

import tempfile
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Protocol

from agents.nursery.protocol import is_of_our_user
from apad_bridge.records.run_directory import RunDirectory
from apad_bridge.scenario.text.text_file import write_atomically
from apad_bridge.supervisor.control_protocol import SOCKET_NAME, short_path
from apad_bridge.supervisor.control_server import refused_line
from apad_bridge.supervisor.line_server import LineServer

_FIXED = ("scenario.yaml", "run.json")
_LOOK_S = 0.5
_CLIENT_S = 5.0


class Far(Protocol):
    """The run on the other machine (`ros/remote_run.py`)."""

    def read(self, file: str, offset: int) -> bytes | None: ...

    def order(self, request: bytes) -> bytes: ...


class Mirror:
    """`update` copies what is new. The socket is there from one update that succeeds until one that does not."""

    def __init__(self, far: Far, folder: Path, unheard: type[Exception]) -> None:
        """`unheard` is what `far` raises while the other machine does not answer."""
        self._far = far
        self._folder = folder
        self._run = RunDirectory(folder)
        self._unheard = unheard
        self._copied = 0
        self._server: LineServer | None = None

    def begin(self) -> None:
        """Copies what a run has from its start. Raises `unheard`."""
        for name in _FIXED:
            write_atomically(self._folder / name, (self._far.read(name, 0) or b"").decode())

    def update(self) -> bool:
        """True if the other machine answered."""
        try:
            summary = None if self._run.summary.exists() else self._far.read(self._run.summary.name, 0)
            new = self._far.read(self._run.journal.name, self._copied)
        except self._unheard:
            self.close()
            return False
        if new:
            with self._run.journal.open("ab") as journal:
                journal.write(new)
            self._copied += len(new)
        # Asked for before the journal: whoever sees the summary then has the whole journal.
        if summary is not None:
            write_atomically(self._run.summary, summary.decode())
        if self._server is None:
            with short_path(self._folder) as path:
                self._server = LineServer(path, self._answered, is_of_our_user)
        return True

    def close(self) -> None:
        """Takes no orders any more."""
        if self._server is not None:
            self._server.close()
            self._server = None
            (self._folder / SOCKET_NAME).unlink(missing_ok=True)

    def _answered(self, request: bytes) -> bytes:
        try:
            return self._far.order(request)
        except self._unheard as error:
            return refused_line(str(error))


@contextmanager
def mirrored(far: Far, unheard: type[Exception]) -> Iterator[Path]:
    """The copy's directory while it is entered; raises `unheard` when the other machine does not answer at first."""
    ended = threading.Event()
    with tempfile.TemporaryDirectory(prefix="musselbed-console-") as folder:
        mirror = Mirror(far, Path(folder), unheard)
        mirror.begin()

        def follow() -> None:
            while not ended.wait(_LOOK_S):
                mirror.update()

        mirror.update()
        thread = threading.Thread(target=follow, name="mirror", daemon=True)
        thread.start()
        try:
            yield Path(folder)
        finally:
            ended.set()
            thread.join(_CLIENT_S)
            mirror.close()
