"""Child processes of a run, in sessions of their own, so that each can die alone; and how a parent reads them.

Until a child is ready, the end of its starter ends it.
"""

from __future__ import annotations

import os
import selectors
import signal
import subprocess
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import IO

from agents.hosting import started
from agents.hosting.interrupts import received_by
from apad_bridge.records.run_directory import RunDirectory
from apad_bridge.runs.parent_protocol import ParentMessage, Said, from_line

_LOOK_S = 0.2
"""Wall seconds without a line, after which a parent looks around."""
_MOST_QUIETS = 6


class Child:
    """One child process; `log` receives its standard error. No context manager: `parent.py` chooses the order of ending."""

    def __init__(
        self, name: str, module: str, arguments: list[str], log: Path, environment: dict[str, str]
    ) -> None:
        self.name = name
        self.log = log
        with log.open("ab") as stderr:
            self._process = subprocess.Popen(
                [*started.PYTHON, "-m", started.__name__, module, *arguments],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=stderr,
                text=True,
                start_new_session=True,
                env={**os.environ, **environment, **started.environment()},
            )
        assert self._process.stdout is not None
        self.lines: IO[str] = self._process.stdout

    @property
    def pid(self) -> int:
        return self._process.pid

    def ask_to_end(self) -> None:
        """Sends SIGTERM: end in order. Unlike SIGINT, it also ends a child in silence that is not yet a program of ours."""
        if self._process.poll() is None:
            self._process.send_signal(signal.SIGTERM)

    def kill(self) -> None:
        """Sends SIGKILL."""
        self._process.kill()

    def wait(self, timeout_s: float) -> int | None:
        """The exit code (negative: the signal that ended it); None when it still runs after `timeout_s`."""
        try:
            return self._process.wait(timeout_s)
        except subprocess.TimeoutExpired:
            return None

    def end(self, timeout_s: float) -> None:
        """Sends SIGTERM, and SIGKILL when the child does not end in time."""
        if self._process.poll() is None:
            self._process.terminate()
            if self.wait(timeout_s) is None:
                self._process.kill()
                self.wait(timeout_s)
        self.lines.close()

    def last_log_line(self) -> str:
        """The last line of its log, for an error message."""
        lines = self.log.read_text(errors="replace").strip().splitlines()
        return lines[-1] if lines else "it said nothing"


class Interrupts:
    """Notes signals that ask to end while it is entered, so that the parent ends things in order instead of dying."""

    def __init__(self) -> None:
        self.interrupted = False
        self._entered = ExitStack()

    def __enter__(self) -> Interrupts:
        self._entered.enter_context(received_by(self._note))
        return self

    def __exit__(self, *_: object) -> None:
        self._entered.close()

    def _note(self) -> None:
        self.interrupted = True


class OrderlyEnd:
    """The end of a supervisor that was asked for it: it may take its time for as long as its records grow."""

    def __init__(self, run_dir: Path, quiet_s: float, clock: Callable[[], float] = time.monotonic) -> None:
        self._directory = RunDirectory(run_dir)
        self._quiet_s = quiet_s
        self._clock = clock
        self._asked_s = self._grew_s = clock()
        self._sizes = self._record_sizes()

    def is_overdue(self) -> bool:
        """True after `quiet_s` wall seconds without a new record, and after six times as long in any case."""
        now_s, sizes = self._clock(), self._record_sizes()
        if sizes != self._sizes:
            self._sizes, self._grew_s = sizes, now_s
        return now_s - self._grew_s > self._quiet_s or now_s - self._asked_s > _MOST_QUIETS * self._quiet_s

    def _record_sizes(self) -> list[int]:
        directory = self._directory
        records = [directory.journal, directory.ends, directory.summary, *directory.bags]
        return [it.stat().st_size if it.exists() else -1 for it in records]


def read_children(
    children: Mapping[str, Child], look: Callable[[], bool] = lambda: False
) -> Iterator[tuple[str, ParentMessage | None]]:
    """Yields each message with its child's name, and None at the end of that child's output, until all have ended.

    A child that is added to `children` meanwhile is read too. `look` is called at least five times a second, and is True
    while more children may come.
    """
    unread: dict[Child, bytes] = {}
    with selectors.DefaultSelector() as selector:
        while True:
            for name, child in children.items():
                if child not in unread:
                    unread[child] = b""
                    selector.register(child.lines, selectors.EVENT_READ, (name, child))
            may_come = look()
            if not (selector.get_map() or may_come):
                return
            for key, _ in selector.select(_LOOK_S):
                name, child = key.data
                chunk = os.read(child.lines.fileno(), 65536)
                *lines, unread[child] = (unread[child] + chunk).split(b"\n")
                for line in lines:
                    yield name, from_line(line.decode(errors="replace"))
                if not chunk:
                    selector.unregister(key.fileobj)
                    if unread[child]:
                        yield name, Said(unread[child].decode(errors="replace"))
                    yield name, None


@contextmanager
def not_suspended() -> Iterator[None]:
    """Ctrl-Z suspends nothing while this is entered: it prints one line. For the main thread alone.

    A parent that was suspended would read its supervisor's lines no more, and the supervisor would wait for it in flight.
    """

    def say(*_: object) -> None:
        # Not print: this may interrupt a print.
        with suppress(OSError):
            os.write(
                2, b"\r\nCtrl-Z does not suspend a mission: it continues, and Ctrl-C ends it in order\r\n"
            )

    before = signal.signal(signal.SIGTSTP, say)
    try:
        yield
    finally:
        signal.signal(signal.SIGTSTP, before)
