"""Ends processes for tests, and waits until they have ended: a signal that was sent is not a process that is gone."""

from __future__ import annotations

import os
import select
import signal
from contextlib import suppress
from pathlib import Path

PATIENCE_S = 60.0


def kill_9(pid: int) -> None:
    """Kills a process, ours to wait for or not, and returns when it has ended."""
    with suppress(ProcessLookupError):
        os.kill(pid, signal.SIGKILL)
    assert gone(pid), f"process {pid} survived a kill for {PATIENCE_S:g} s"


def kill_supervisor(run_dir: Path) -> None:
    kill_9(int((run_dir / "supervisor.pid").read_text().split()[0]))


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
