"""Checks this machine's limits for one user: open files, processes, terminals, memory, disk, ports on the loopback."""

from __future__ import annotations

import os
import resource
import shutil
import socket
from collections.abc import Iterator
from pathlib import Path

from apad_bridge.doctor.finding import Check, Finding, fail, ok, warn

AGENTS_BY_DEFAULT = 1000
_OWN_FILES = 256
"""Open files of the nursery and the supervisor, beside one for each aMussel."""
_OWN_PROCESSES = 64
_MB = 1 << 20
MERGING = "/sys/kernel/mm/ksm/run"
_AGENT_MB, _MERGED_MB, _OWN_MB = 2.0, 0.9, 300
"""Memory of a whole board after a day, with the kernel's part (`benchmarks/run fleet`), and of everything else."""


def check_open_files(agents: int, hard: int | None = None) -> Finding:
    """Checks RLIMIT_NOFILE's hard limit (`hard` replaces it); musselbed raises the soft limit to it."""
    limit = resource.getrlimit(resource.RLIMIT_NOFILE)[1] if hard is None else hard
    shown = "unlimited" if limit == resource.RLIM_INFINITY else str(limit)
    if limit != resource.RLIM_INFINITY and limit < agents + _OWN_FILES:
        return fail(
            f"at most {shown}, too few for {agents} aMussels",
            f"ulimit -Hn {agents + _OWN_FILES} (as root), or --agents {max(0, limit - _OWN_FILES)}",
        )
    return ok(f"at most {shown}, enough for {agents} aMussels")


def check_processes(agents: int, hard: int | None = None, threads_max: int | None = None) -> Finding:
    """Checks the room for a process for each aMussel and some threads for ROS."""
    limits = {
        "RLIMIT_NPROC": resource.getrlimit(resource.RLIMIT_NPROC)[1] if hard is None else hard,
        "kernel.threads-max": _number("/proc/sys/kernel/threads-max") if threads_max is None else threads_max,
        "kernel.pid_max": _number("/proc/sys/kernel/pid_max"),
        "the container's pids.max": _number("/sys/fs/cgroup/pids.max"),
    }
    bounded = {name: limit for name, limit in limits.items() if limit not in (None, resource.RLIM_INFINITY)}
    if not bounded:
        return ok("no limit")
    name, limit = min(((name, limit or 0) for name, limit in bounded.items()), key=lambda pair: pair[1])
    if limit < agents + _OWN_PROCESSES:
        return fail(
            f"{name} is {limit}, too few for {agents} aMussels",
            f"raise {name} to {agents + _OWN_PROCESSES}, or use --hosting one_process",
        )
    return ok(f"{name} of {limit} is enough for {agents} aMussels")


def check_terminals() -> Finding:
    """Reports the limit. Each serial modem will need a terminal; nothing in this version does."""
    limit = _number("/proc/sys/kernel/pty/max")
    return ok("unknown" if limit is None else f"at most {limit}; none is needed without a modem")


def check_memory(agents: int, free_mb: int | None = None, merges: bool | None = None) -> Finding:
    """Checks the memory for a process for each aMussel. Kernels that merge same pages keep most of them only once."""
    merges = _number(MERGING) == 1 if merges is None else merges
    free_mb = _available_mb() if free_mb is None else free_mb
    needed_mb = agents * (_MERGED_MB if merges else _AGENT_MB) + _OWN_MB
    how = "same pages are merged" if merges else f"same pages are not merged ({MERGING})"
    found = f"{free_mb} MB free, {agents} aMussels take {needed_mb:.0f} at most; {how}"
    if free_mb >= needed_mb:
        return ok(found)
    mend = "fewer aMussels, or --hosting one_process"
    return fail(found, mend if merges else f"echo 1 > {MERGING} (as root); or {mend}")


def check_disk(folder: Path, free: int | None = None) -> Finding:
    """Checks the room for runs below `folder`. A simulated hour of 12 aMussels with its bag takes some 10 MB."""
    free = shutil.disk_usage(folder).free if free is None else free
    room = f"{free // _MB} MB free in {folder}"
    if not os.access(folder, os.W_OK):
        return fail(f"{folder} cannot be written to", "run musselbed in a folder of yours, or use --out DIR")
    if free < 100 * _MB:
        return fail(room, "make room, or use --out DIR on another disk")
    if free < 1024 * _MB:
        return warn(room, "enough for short runs only: make room, or use --out DIR on another disk")
    return ok(room)


def check_ros_log() -> Finding:
    """Checks the folder of rospy's log. A run as root leaves one that its user cannot write."""
    home = os.environ.get("ROS_HOME") or Path.home() / ".ros"
    folder = Path(os.environ.get("ROS_LOG_DIR") or Path(home, "log"))
    there = next(it for it in (folder, *folder.absolute().parents) if it.exists())
    if there.is_dir() and (there != folder or os.access(there, os.W_OK | os.X_OK)):
        return ok(str(folder))  # where rospy cannot make the folder, it goes on without a log
    return fail(f"rospy cannot write its log in {folder}", "set ROS_LOG_DIR to a folder of yours")


def check_loopback() -> Iterator[Finding]:
    """Checks 127.0.0.1, where a run of our own needs a few free ports and picks them itself."""
    held: list[socket.socket] = []
    try:
        for _ in range(4):
            held.append(socket.create_server(("127.0.0.1", 0)))
        with socket.create_connection(held[0].getsockname(), timeout=2):
            pass
        numbers = ", ".join(str(server.getsockname()[1]) for server in held)
        yield ok(f"ports are free ({numbers} were given) and can be reached")
    except OSError as error:
        yield fail(
            f"127.0.0.1 does not work: {error}",
            "ip link set lo up, and see what the firewall blocks",
        )
    finally:
        for server in held:
            server.close()


def _available_mb() -> int:
    lines = Path("/proc/meminfo").read_text().splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith("MemAvailable:")) // 1024


def _number(path: str) -> int | None:
    try:
        text = Path(path).read_text().strip()
    except OSError:
        return None
    return int(text) if text.isdigit() else None


CHECKS: tuple[Check[int], ...] = (
    Check("open files", check_open_files),
    Check("processes", check_processes),
    Check("memory", check_memory, may_be_red_in_trial=True),
    Check("pseudo-terminals", lambda _: check_terminals()),
    Check("disk", lambda _: check_disk(Path.cwd()), may_be_red_in_trial=True),
    Check("ROS's log", lambda _: check_ros_log()),
    Check("loopback", lambda _: check_loopback()),
)
"""Checks for so many aMussels."""
