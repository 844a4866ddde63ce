"""The one supervisor of a run: its lock on the run's directory, and the file that names it.

A supervisor holds its run's directory locked (flock) for as long as it lives, so that no second one touches the records. A
file there names the supervisor: its pid and the kernel's start time of that process, so that a reused pid names no
supervisor.
"""

from __future__ import annotations

import fcntl
import os
import signal
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from apad_bridge.vehicle.link_errors import PeerFailed

_PID_FILE = "supervisor.pid"


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


def signal_supervisor(run_dir: Path, number: signal.Signals) -> int | None:
    """Sends the signal to the run's living supervisor, whoever started it; returns its pid, None when there is none."""
    if (pid := supervisor_of(run_dir)) is None:
        return None
    with suppress(ProcessLookupError):
        process = os.pidfd_open(pid)
        try:
            # The number may be another process's by now. This one it stays as long as the descriptor is open.
            if supervisor_of(run_dir) == pid:
                signal.pidfd_send_signal(process, number)
                return pid
        finally:
            os.close(process)
    return None


def _start_time(pid: int) -> int | None:
    """The process's start in clock ticks since boot; None if it is gone or a zombie (proc(5), fields 3, 22)."""
    try:
        after_name = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    except OSError:
        return None
    return None if after_name[0] in "ZX" else int(after_name[19])
