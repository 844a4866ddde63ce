"""Memory, descriptors and threads of each process in long real time, and in ten days at once: they have to stay flat.

- Twice 100 minutes at real time and theta 30, over ROS: the flight of `benchmarks/run console` with 24 aMussels, and a
  browser that stays. In each leg ten aMussels' processes are killed. The first leg ends as a power cut ends it, with a kill
  of all processes at once, and `musselbed resume` flies the second. The bare rospy node that reads the ticks is the floor:
  what its memory does is rospy's own.
- Ten days of 120 aMussels with five aPads at theta 30, in virtual time, each aMussel a process. The aPads' energy is
  unlimited.

Every process is looked at each 10 s. The first 30 % fills caches and does not count; `..._per_hour` and `..._per_day` are
slopes of a straight line through the rest with the halves of their intervals of 95 %, the latter by days of the aMussels'
time. Memory is what is private to a process, so that no other program of the machine changes it. docs/processes.md says
why it rises slowly: the bag's index, and the pages that an aMussel copies. The laws of `musselbed check` are checked at
the end.

The published stack advertises a topic for each aMussel when it first docks, and rospy takes a descriptor and a thread for
its connection at either end. So `docked_so_far` stands beside the table: that growth ends with the fleet.
"""

from __future__ import annotations

import json
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from collections import defaultdict
from collections.abc import Iterator
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from apad_bridge.commands.look.check import broken_rules
from benchmarks.console import MUSSELBED, Clients, Flight, end_program
from benchmarks.rows import told

AGENTS, KILLS = 24, 10
LOOK_S, SHORT_LOOK_S = 10.0, 1.0
SHORT_MINUTES, SHORT_DAYS = 0.5, 0.1
WARM_PART = 0.3
REPORT_S = 120.0
"""The longest that a report of the flight may take."""
PROC = Path("/proc")
COMMAND = [sys.executable, *MUSSELBED]
SEVERAL = Path(__file__).parents[3] / "launch_scripts/scenarios/bay-120.yaml"
UNLIMITED_WH = 1e6
COUNTED = {"private_mb": ".1f", "descriptors": "d", "threads": "d"}
"""The counted quantities, each with the format of its cells."""
_FEWEST = 4
"""A line through fewer moments has no interval."""
_TAIL_BYTES = 100_000
"""More than a tick's lines of a journal."""


@dataclass(frozen=True, slots=True)
class Used:
    """Private memory, descriptors and threads of the processes of one kind together, at a moment of the flight."""

    at_s: float
    processes: int
    private_mb: float
    descriptors: int
    threads: int


def measure(minutes: float = 100.0, days: float = 10.0, short: bool = False) -> dict[str, Any]:
    look_s = SHORT_LOOK_S if short else LOOK_S
    minutes, days = (SHORT_MINUTES, SHORT_DAYS) if short else (minutes, days)
    real_time = told(at_real_time(minutes, look_s))
    return {"real_time": real_time, "virtual_time": told(in_virtual_time(days, look_s))}


def at_real_time(minutes: float, look_s: float) -> dict[str, Any]:
    with ExitStack() as stack:
        flight = Flight(stack, round(2 * 60 * minutes), AGENTS)
        browser = Clients(flight.url, 1)
        stack.callback(browser.close)
        legs = [Leg(flight, look_s, random.Random(1), 60 * minutes)]
        for pid in tree_of(flight.command.pid):
            _kill(pid)
        flight.resume()
        legs.append(Leg(flight, look_s, random.Random(2), 60 * minutes))
        ticks = flight.ticks()
        laws = sum(map(len, broken_rules(flight.run).values()))
        began_s = time.monotonic()
        words = [*COMMAND, "report", str(flight.run), "--out", str(flight.run.with_name("report"))]
        subprocess.run(words, check=True, stdout=subprocess.DEVNULL, timeout=REPORT_S)
        report_s = time.monotonic() - began_s
    return {
        "agents": AGENTS,
        "minutes": minutes,
        "ticks": len(ticks),
        "broken_rules": laws,
        "report_s": report_s,
        "legs": [it.figures(ticks) for it in legs],
    }


class Leg:
    """Looks at a flight's processes for so many seconds, and kills aMussels at times drawn by `rng`."""

    def __init__(self, flight: Flight, look_s: float, rng: random.Random, seconds: float) -> None:
        self._seen: dict[str, list[Used]] = defaultdict(list)
        self._docked: list[int] = []
        self._from_s = time.monotonic()
        kills = sorted(rng.uniform(0, 0.9 * seconds) for _ in range(KILLS))
        kinds = {
            "command": flight.command.pid,
            "aPad's node": flight.apad.process.pid,
            "console": flight.console.process.pid,
            "bare rospy node": flight.reader.process.pid,
        }
        self.killed = 0
        while not _ended(flight.command, look_s) and time.monotonic() < self._from_s + seconds:
            for kind, used in _looked(kinds, time.monotonic()):
                self._seen[kind].append(used)
            self._docked.append(_docked_so_far(flight.run))
            if kills and time.monotonic() > self._from_s + kills[0]:
                del kills[0]
                if living := _amussels(flight.command.pid):
                    _kill(rng.choice(living))
                    self.killed += 1
        self._until_s = time.monotonic()

    def figures(self, ticks: list[tuple[float, float]]) -> dict[str, Any]:
        heard = [it for it in ticks if self._from_s <= it[1] < self._until_s]
        return {
            "killed": self.killed,
            "ticks": len(heard),
            "docked_so_far": _three(_counted(self._docked)),
            "late_ms_per_hour": _slope(
                [at_s / 3600 for _, at_s in _counted(heard)],
                [1000 * (at_s - mission_s) for mission_s, at_s in _counted(heard)],
            ),
            "rows": [_row(kind, used, "hour", 3600) for kind, used in self._seen.items()],
        }


def in_virtual_time(days: float, look_s: float) -> dict[str, Any]:
    seen: dict[str, list[Used]] = defaultdict(list)
    began_s = time.monotonic()
    with ExitStack() as stack:
        home = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="musselbed-")))
        data = yaml.safe_load(SEVERAL.read_text())
        theta = data["theta"]
        data |= {"duration_s": round(86_400 * days / theta)}
        data["apad"]["battery"] = {"capacity_wh": UNLIMITED_WH}
        (home / "flown.yaml").write_text(yaml.safe_dump(data))
        run = home / "run"
        command = subprocess.Popen(
            [*COMMAND, "run", home / "flown.yaml", "--time", "asap", "--json", "--out", run],
            stdout=subprocess.DEVNULL,
        )
        stack.callback(end_program, command)
        while not _ended(command, look_s):
            mission_s = _mission_s(run)
            for kind, used in _looked({"command": command.pid}, mission_s * theta):
                seen[kind].append(used)
        if command.returncode != 0:
            raise RuntimeError(f"the flight ended with exit code {command.returncode}")
        laws = sum(
            len(found) for it in run.glob("*/journal.jsonl") for found in broken_rules(it.parent).values()
        )
    return {
        "agents": data["fleet"]["count"],
        "apads": 1 + len(data["apads"]),
        "days": days,
        "took_s": time.monotonic() - began_s,
        "broken_rules": laws,
        "rows": [_row(kind, used, "day", 86_400) for kind, used in seen.items()],
    }


def _ended(command: subprocess.Popen[bytes], look_s: float) -> bool:
    """Waits until the next look is due; True if the flight has ended before."""
    try:
        command.wait(look_s)
    except subprocess.TimeoutExpired:
        return False
    return True


def _mission_s(run: Path) -> float:
    """The mission time of the newest whole line in any journal of the run; 0 before the first."""
    newest_s = 0.0
    for journal in run.glob("*/journal.jsonl"):
        with open(journal, "rb") as file:
            file.seek(max(0, journal.stat().st_size - _TAIL_BYTES))
            for line in file.read().split(b"\n")[1:-1]:
                newest_s = max(newest_s, json.loads(line)["t"] / 1000)
    return newest_s


def _looked(kinds: dict[str, int], at_s: float) -> Iterator[tuple[str, Used]]:
    """Each kind with what it uses now; what runs below the command is a kind of its own."""
    trees = {kind: [pid] for kind, pid in kinds.items()}
    for pid in tree_of(kinds["command"])[1:]:
        kind = "nursery and aMussels" if "agents.nursery" in _command_line(pid) else "supervisor"
        trees.setdefault(kind, []).append(pid)
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


def tree_of(pid: int) -> list[int]:
    """The pids of a process and of all below it."""
    children = children_of_all()
    found = [pid]
    for it in found:
        found += children[it]
    return found


def _kill(pid: int) -> None:
    with suppress(ProcessLookupError):  # a child may end with its parent
        os.kill(pid, signal.SIGKILL)


def _amussels(command: int) -> list[int]:
    return [it for it in tree_of(command) if _name(it).startswith("amussel")]


def _name(pid: int) -> str:
    try:
        return (PROC / str(pid) / "comm").read_text()
    except OSError:
        return ""


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


def _docked_so_far(run: Path) -> int:
    """The number of aMussels that docked at least once, by the journal."""
    with open(run / "journal.jsonl") as lines:
        # The flight may be writing the last line.
        events = [json.loads(line) for line in lines if '"dock"' in line and line.endswith("}\n")]
    return len(
        {
            event["agent"]
            for event in events
            if event["kind"] == "primitive" and event["name"] == "dock" and event["phase"] == "succeeded"
        }
    )


def _counted(looks: list[Any]) -> list[Any]:
    return looks[int(WARM_PART * len(looks)) : -1] or looks[-1:]  # at the last look it may be ending


def _three(values: list[Any]) -> list[Any]:
    return [values[0], values[len(values) // 2], values[-1]]


def _row(kind: str, used: list[Used], unit: str, unit_s: float) -> dict[str, Any]:
    counted = _counted(used)
    row: dict[str, Any] = {"process": kind, "processes": counted[-1].processes}
    for key in COUNTED:
        values = [getattr(it, key) for it in counted]
        times = [(it.at_s - counted[0].at_s) / unit_s for it in counted]
        row[key] = _three(values)
        row[f"{key}_per_{unit}"] = _slope(times, values)
    return row


def _slope(times: list[float], values: list[float]) -> list[float] | None:
    """The slope of a straight line, and the half of its interval of 95 %; None for too few moments.

    The interval takes the moments as independent. Those of memory are not, so it is too narrow there.
    """
    if len(set(times)) < _FEWEST:
        return None
    line, covariance = np.polyfit(times, values, 1, cov=True)
    return [float(line[0]), 2 * float(covariance[0, 0]) ** 0.5]
