"""Which process supervises a run: its pid and the kernel's start time of it, so that a pid used again names nobody."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator
from pathlib import Path

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
