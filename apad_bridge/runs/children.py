"""Child processes of a run in sessions of their own, none the parent of another, so that each can die alone.

Until a child is ready, the end of its starter ends it.

A supervisor holds its run's directory locked (flock) for as long as it lives, so that no second one touches the records. A
file there names the supervisor: its pid and the kernel's start time of that process, so that a reused pid names no
supervisor.
"""

from __future__ import annotations

import fcntl
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO

from agents.hosting import started
from apad_bridge.vehicle.errors import PeerFailed

_PID_FILE = "supervisor.pid"


class Child:
    """One child process; `log` receives its standard error. No context manager: the caller chooses the order of ending."""

    def __init__(
        self, name: str, module: str, arguments: list[str], log: Path, environment: dict[str, str]
    ) -> None:
        self.name = name
        self.log = log
        with log.open("ab") as stderr:
            self._process = subprocess.Popen(
                [sys.executable, "-m", started.__name__, module, *arguments],
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
        """Sends SIGINT: end in order."""
        if self._process.poll() is None:
            self._process.send_signal(signal.SIGINT)

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


@contextmanager
def supervising(run_dir: Path) -> Iterator[None]:
    """Makes this process the run's one supervisor while this context is entered; PeerFailed when another process is it.

    The lock ends with the process, however that dies; no child inherits it.
    """
    path = run_dir / _PID_FILE
    lock = os.open(run_dir, os.O_RDONLY | os.O_DIRECTORY)
    try:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            pid = supervisor_of(run_dir)
            raise PeerFailed(
                f"{run_dir} has a living supervisor{'' if pid is None else f' (pid {pid})'}: there is nothing to resume"
            ) from None
        path.write_text(f"{os.getpid()} {_start_time(os.getpid())}\n")
        try:
            yield
        finally:
            path.unlink(missing_ok=True)
    finally:
        os.close(lock)


def supervisor_of(run_dir: Path) -> int | None:
    """The pid of the run's living supervisor; None when there is none."""
    try:
        pid, started = (int(field) for field in (run_dir / _PID_FILE).read_text().split())
    except (OSError, ValueError):
        return None
    return pid if _start_time(pid) == started else None


def _start_time(pid: int) -> int | None:
    """The process's start in clock ticks since boot; None if it is gone or a zombie (proc(5), fields 3, 22)."""
    try:
        after_name = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    except OSError:
        return None
    return None if after_name[0] in "ZX" else int(after_name[19])
