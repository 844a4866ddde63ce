"""Child processes in sessions of their own, none the parent of another: each can die alone, and all are ended in order.

Which process supervises a run: its pid and the kernel's start time of it, so that a pid used again names nobody.

SIGTERM as Ctrl-C: whoever is asked to end, at whatever moment, first ends what it has started.
"""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO

_NAME = "supervisor.pid"


def supervisor_of(run_dir: Path) -> int | None:
    """The pid of the run's living supervisor; None when there is none."""
    try:
        pid, started = (int(word) for word in (run_dir / _NAME).read_text().split())
    except (OSError, ValueError):
        return None
    return pid if _start_time(pid) == started else None


@contextlib.contextmanager
def supervising(run_dir: Path) -> Iterator[None]:
    """Names this process as the run's supervisor while it lasts."""
    path = run_dir / _NAME
    path.write_text(f"{os.getpid()} {_start_time(os.getpid())}\n")
    try:
        yield
    finally:
        path.unlink(missing_ok=True)


def _start_time(pid: int) -> int | None:
    """Clock ticks since boot at which it started; None for a process that is gone or a zombie (proc(5), fields 3, 22)."""
    try:
        after_name = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    except OSError:
        return None
    return None if after_name[0] in "ZX" else int(after_name[19])


@contextmanager
def terminated_as_interrupted() -> Iterator[None]:
    """SIGTERM raises KeyboardInterrupt while this is entered. For the main thread alone (ValueError elsewhere)."""
    before = signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


class Child:
    """One child, its standard error kept in `log`. A context is not enough: the order of ending is the caller's."""

    def __init__(
        self, name: str, module: str, arguments: list[str], log: Path, environment: dict[str, str]
    ) -> None:
        self.name = name
        self.log = log
        with log.open("ab") as stderr:
            self._process = subprocess.Popen(
                [sys.executable, "-m", module, *arguments],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=stderr,
                text=True,
                start_new_session=True,
                env={**os.environ, **environment},
            )
        assert self._process.stdout is not None
        self.lines: IO[str] = self._process.stdout

    @property
    def pid(self) -> int:
        return self._process.pid

    def ask_to_end(self) -> None:
        """SIGINT: end in order."""
        if self._process.poll() is None:
            self._process.send_signal(signal.SIGINT)

    def wait(self, timeout_s: float) -> int | None:
        """The exit code (negative: the signal that ended it); None when it still runs after `timeout_s`."""
        try:
            return self._process.wait(timeout_s)
        except subprocess.TimeoutExpired:
            return None

    def end(self, timeout_s: float) -> None:
        """SIGTERM, and SIGKILL for one that does not end in time."""
        if self._process.poll() is None:
            self._process.terminate()
            if self.wait(timeout_s) is None:
                self._process.kill()
                self.wait(timeout_s)
        self.lines.close()

    def last_words(self) -> str:
        """The last line of its log, for an error message."""
        lines = self.log.read_text(errors="replace").strip().splitlines()
        return lines[-1] if lines else "it said nothing"
