"""Memory, descriptors and threads of each process in an hour at real time and theta 30: they have to stay flat.

The flight is that of `benchmarks/run console`, with a browser that stays. Every process is looked at each 10 s. The first
quarter fills caches and does not count; `..._per_hour` are slopes of a straight line through the rest. Memory is what is
private to a process, so that no other program of the machine changes it. The bare rospy node that reads the ticks is the
floor: what its memory does is rospy's own. The laws of `musselbed check` are checked at the end.
"""

from __future__ import annotations

import os
import subprocess
import time
from collections import defaultdict
from collections.abc import Iterator
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from apad_bridge.commands.check import broken_laws
from benchmarks.console import AGENTS, Clients, Flight

LOOK_S = 10.0
WARM_PART = 0.25
PROC = Path("/proc")


@dataclass(frozen=True, slots=True)
class Used:
    """Private memory, descriptors and threads of the processes of one kind together, at a moment."""

    at_s: float
    processes: int
    private_mb: float
    descriptors: int
    threads: int


def measure(minutes: float = 60.0) -> dict[str, Any]:
    seen: dict[str, list[Used]] = defaultdict(list)
    with ExitStack() as stack:
        flight = Flight(stack, round(60 * minutes))
        browser = Clients(flight.url, 1)
        stack.callback(browser.close)
        kinds = {
            "command": flight.command.pid,
            "aPad's node": flight.apad.process.pid,
            "console": flight.console.process.pid,
            "bare rospy node": flight.reader.process.pid,
        }
        while True:
            with suppress(subprocess.TimeoutExpired):
                flight.command.wait(LOOK_S)
                break
            for kind, used in _looked(kinds, time.monotonic()):
                seen[kind].append(used)
        ticks = len(flight.ticks())
        laws = sum(map(len, broken_laws(flight.run).values()))
    return {
        "agents": AGENTS,
        "minutes": minutes,
        "ticks": ticks,
        "broken_laws": laws,
        "rows": [_row(kind, used) for kind, used in seen.items()],
    }


def _looked(kinds: dict[str, int], at_s: float) -> Iterator[tuple[str, Used]]:
    """Each kind with what it uses now; the command's children are a kind each, and their children belong to them."""
    children = children_of_all()
    trees = {kind: [pid] for kind, pid in kinds.items()}
    for pid in children[kinds["command"]]:
        kind = "nursery and aMussels" if "agents.nursery" in _command_line(pid) else "supervisor"
        trees[kind] = [pid, *children[pid]]
    for kind, pids in trees.items():
        found = [used for pid in pids if (used := _used(pid)) is not None]
        if found:
            private_kb, descriptors, threads = (sum(it) for it in zip(*found, strict=True))
            yield kind, Used(at_s, len(found), private_kb / 1024, descriptors, threads)


def children_of_all() -> dict[int, list[int]]:
    """The pids of each process's children, by its own."""
    found: dict[int, list[int]] = defaultdict(list)
    for folder in PROC.iterdir():
        if folder.name.isdigit():
            with suppress(OSError):
                # The name of a program may hold blanks and brackets.
                fields = (folder / "stat").read_text().rpartition(")")[2].split()
                found[int(fields[1])].append(int(folder.name))
    return found


def _command_line(pid: int) -> str:
    try:
        return (PROC / str(pid) / "cmdline").read_text().replace("\0", " ")
    except OSError:
        return ""


def _used(pid: int) -> tuple[int, int, int] | None:
    """(kB of private memory, descriptors, threads); None for a process that has just ended."""
    folder = PROC / str(pid)
    try:
        rollup = dict(
            line.split(":", 1) for line in (folder / "smaps_rollup").read_text().splitlines() if ":" in line
        )
        private_kb = sum(int(rollup[key].split()[0]) for key in ("Private_Clean", "Private_Dirty"))
        return private_kb, len(os.listdir(folder / "fd")), len(os.listdir(folder / "task"))
    except (OSError, KeyError):
        return None


def _row(kind: str, used: list[Used]) -> dict[str, Any]:
    counted = used[int(WARM_PART * len(used)) : -1]  # at the last look it may be ending
    row: dict[str, Any] = {"process": kind, "processes": counted[-1].processes}
    for key in ("private_mb", "descriptors", "threads"):
        values = [getattr(it, key) for it in counted]
        hours = [(it.at_s - counted[0].at_s) / 3600 for it in counted]
        row[key] = [values[0], values[len(values) // 2], values[-1]]
        row[f"{key}_per_hour"] = float(np.polyfit(hours, values, 1)[0]) if len(values) > 1 else None
    return row


def show(result: dict[str, Any], console: Console) -> None:
    table = Table(
        "process",
        "MB after a quarter, middle, end",
        "an hour",
        "descriptors",
        "an hour",
        "threads",
        "an hour",
    )
    for row in result["rows"]:
        cells = [f"{row['process']} ({row['processes']})"]
        for key, form in (("private_mb", ".1f"), ("descriptors", "d"), ("threads", "d")):
            slope = row[f"{key}_per_hour"]
            cells += [
                ", ".join(format(it, form) for it in row[key]),
                "unknown" if slope is None else f"{slope:+.2f}",
            ]
        table.add_row(*cells)
    console.print(table)
    console.print(
        f"{result['minutes']:g} minutes, {result['agents']} aMussels, {result['ticks']} ticks, "
        f"{result['broken_laws']} broken laws"
    )
