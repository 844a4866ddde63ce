"""What this machine gives to one user: open files, processes, terminals, room on the disk, ports on the loopback."""

from __future__ import annotations

import os
import resource
import shutil
import socket
from collections.abc import Iterator
from pathlib import Path

from apad_bridge.diagnosis.finding import Finding, fail, ok, warn

AGENTS_BY_DEFAULT = 1000
_OWN_FILES = 256
"""Of the nursery and the supervisor, beside one for each aMussel."""
_OWN_PROCESSES = 64
_MB = 1 << 20


def check_open_files(agents: int, hard: int | None = None) -> Finding:
    """`hard` is RLIMIT_NOFILE's hard limit by default; musselbed raises the soft one to it."""
    limit = resource.getrlimit(resource.RLIMIT_NOFILE)[1] if hard is None else hard
    shown = "unlimited" if limit == resource.RLIM_INFINITY else str(limit)
    if limit != resource.RLIM_INFINITY and limit < agents + _OWN_FILES:
        return fail(
            "open files",
            f"at most {shown}, too few for {agents} aMussels",
            f"ulimit -Hn {agents + _OWN_FILES} (as root), or --agents {max(0, limit - _OWN_FILES)}",
        )
    return ok("open files", f"at most {shown}, enough for {agents} aMussels")


def check_processes(agents: int, hard: int | None = None, threads_max: int | None = None) -> Finding:
    """A process each for the aMussels, and some threads for ROS."""
    limits = {
        "RLIMIT_NPROC": resource.getrlimit(resource.RLIMIT_NPROC)[1] if hard is None else hard,
        "kernel.threads-max": _number("/proc/sys/kernel/threads-max") if threads_max is None else threads_max,
        "kernel.pid_max": _number("/proc/sys/kernel/pid_max"),
        "the container's pids.max": _number("/sys/fs/cgroup/pids.max"),
    }
    bounded = {name: limit for name, limit in limits.items() if limit not in (None, resource.RLIM_INFINITY)}
    if not bounded:
        return ok("processes", "no limit")
    name, limit = min(((name, limit or 0) for name, limit in bounded.items()), key=lambda pair: pair[1])
    if limit < agents + _OWN_PROCESSES:
        return fail(
            "processes",
            f"{name} is {limit}, too few for {agents} aMussels",
            f"raise {name} to {agents + _OWN_PROCESSES}, or use --hosting one_process",
        )
    return ok("processes", f"{name} of {limit} is enough for {agents} aMussels")


def check_terminals() -> Finding:
    """Serial modems will need one each; nothing in this version does."""
    limit = _number("/proc/sys/kernel/pty/max")
    return ok(
        "pseudo-terminals", "unknown" if limit is None else f"at most {limit}; none is needed without a modem"
    )


def check_disk(folder: Path, free: int | None = None) -> Finding:
    """Room for run directories below `folder`. A simulated hour of 12 aMussels with its bag takes some 10 MB."""
    free = shutil.disk_usage(folder).free if free is None else free
    room = f"{free // _MB} MB free in {folder}"
    if not os.access(folder, os.W_OK):
        return fail(
            "disk", f"{folder} cannot be written to", "run musselbed in a folder of yours, or use --out DIR"
        )
    if free < 100 * _MB:
        return fail("disk", room, "make room, or use --out DIR on another disk")
    if free < 1024 * _MB:
        return warn("disk", room, "enough for short runs only: make room, or use --out DIR on another disk")
    return ok("disk", room)


def check_loopback(ports: int = 4) -> Iterator[Finding]:
    """A run of our own needs a few free ports on 127.0.0.1 and picks them itself."""
    held: list[socket.socket] = []
    try:
        for _ in range(ports):
            held.append(socket.create_server(("127.0.0.1", 0)))
        with socket.create_connection(held[0].getsockname(), timeout=2):
            pass
        numbers = ", ".join(str(server.getsockname()[1]) for server in held)
        yield ok("loopback", f"ports are free ({numbers} were given) and can be reached")
    except OSError as error:
        yield fail(
            "loopback",
            f"127.0.0.1 does not work: {error}",
            "ip link set lo up, and see what the firewall blocks",
        )
    finally:
        for server in held:
            server.close()


def _number(path: str) -> int | None:
    try:
        text = Path(path).read_text().strip()
    except OSError:
        return None
    return int(text) if text.isdigit() else None
