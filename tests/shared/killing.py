"""Ends and stops processes for tests, and waits until it is so: a signal that was sent is not a process that is gone."""

from __future__ import annotations

import os
import select
import signal
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

PATIENCE_S = 180.0


def kill_9(pid: int) -> None:
    """Kills a process, ours to wait for or not, and returns when it has ended."""
    with suppress(ProcessLookupError):
        os.kill(pid, signal.SIGKILL)
    assert gone(pid), f"process {pid} survived a kill for {PATIENCE_S:g} s"


def kill_supervisor(run_dir: Path) -> None:
    kill_9(pid_of_supervisor(run_dir))


def pid_of_supervisor(run_dir: Path) -> int:
    return int((run_dir / "supervisor.pid").read_text().split()[0])


@contextmanager
def standing_still(pid: int) -> Iterator[None]:
    """The process is stopped meanwhile, ours or not: what it wrote last holds until it goes on, or is killed."""
    os.kill(pid, signal.SIGSTOP)
    try:
        until_s = time.monotonic() + PATIENCE_S
        # The kernel tells the stop of a process to its parent alone.
        while Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] not in "TZ":
            assert time.monotonic() < until_s, f"process {pid} does not stop"
            os.sched_yield()
        yield
    finally:
        with suppress(ProcessLookupError):
            os.kill(pid, signal.SIGCONT)


def gone(pid: int, timeout_s: float = PATIENCE_S) -> bool:
    """True if the process ends within the time; for one that is not ours to wait for."""
    try:
        descriptor = os.pidfd_open(pid)
    except ProcessLookupError:
        return True
    poll = select.poll()
    poll.register(descriptor, select.POLLIN)
    try:
        return bool(poll.poll(timeout_s * 1000))
    finally:
        os.close(descriptor)
