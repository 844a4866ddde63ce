"""A thousand aMussels on two machines, served by one mission: time to be heard, and a cut of the link between them.

The machines are network namespaces. The first has the master, an aPad of generation B, the mission and half of the
aMussels; the second has the other half. So three supervisors are on one master, with disjoint ids, all in real time. Once
the mission has heard every aMussel, and a minute later, the link is cut and heals. `silent` counts the aMussels of each
machine whose packets the mission has not heard for three report periods at the end of the cut; `again_s` is the wall time
from the healing until the mission has heard every one of the second machine again. `rate` is the mission's time over the
wall's before the cut.
"""

from __future__ import annotations

import subprocess
import tempfile
import time
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table
from two_machines import Link, Machine, Programs, linked_machines, master_uri, why_no_two_machines

from apad_bridge.records.event_kinds import EventKind
from apad_bridge.records.journal import JournalTail
from apad_bridge.scenario.loader import from_data, load, resolve, write_resolved
from benchmarks.network import DESPITE, MUSSELBED, ROOT
from benchmarks.soak import children_of_all

ON_EACH = 500
THETA = 30
PERIOD_S = 10.0
"""Mission time between two reports of an aMussel."""
CUT_S = 60.0
"""Mission time of the cut, which a busy machine stretches."""
FLEETS = ("fleet-one", "fleet-two")


def measure(minutes: float = 10.0) -> dict[str, Any]:
    """`minutes` is the patience with each step."""
    if why := why_no_two_machines():
        raise SystemExit(f"this machine cannot play two: {why}")
    with tempfile.TemporaryDirectory(prefix="musselbed-hosts-") as folder:
        return fly(ON_EACH, Path(folder), 60 * minutes)


def written(home: Path, name: str, first_id: int, count: int) -> Path:
    """A scenario for these aMussels, in one square for all of them."""
    data = resolve(load(ROOT / "launch_scripts" / "scenarios" / "real-apad.yaml"))
    data |= {"theta": THETA, "duration_s": 86_400.0}
    data["fleet"] |= {"count": count, "first_id": first_id, "start": {"charge": [0.5, 0.9]}}
    data["apad"] |= {"generation": "b"}
    data["hearing"]["report_period_s"] = PERIOD_S
    write_resolved(home / f"{name}.yaml", from_data(data, name))
    return home / f"{name}.yaml"


class Heard:
    """The mission time of each aMussel's newest packet, by the mission's journal."""

    def __init__(self, run: Path) -> None:
        self.newest_ms: dict[int, int] = {}
        self.now_ms = 0
        self.services = 0
        self._path = run / "journal.jsonl"
        self._tail: JournalTail | None = None

    def look(self) -> None:
        if self._tail is None and self._path.exists():
            self._tail = JournalTail(self._path)
        for line in () if self._tail is None else self._tail.read_new().lines:
            self.now_ms = max(self.now_ms, line["t"])
            if line["kind"] == EventKind.BELIEF:
                self.newest_ms[line["id"]] = max(self.newest_ms.get(line["id"], 0), line["heard"])
            self.services += line["kind"] == EventKind.RELEASED and bool(line["full"])


def fly(on_each: int, home: Path, patience_s: float) -> dict[str, Any]:
    """Flies it with so many aMussels on each machine, and returns the figures."""
    ids = {FLEETS[n]: range(1 + n * on_each, 1 + (n + 1) * on_each) for n in (0, 1)}
    with ExitStack() as stack:
        one, two, lose = stack.enter_context(linked_machines(Link()))
        programs = Programs(home, master_uri(one), stack, patience_s)
        started: dict[str, subprocess.Popen[bytes]] = {}

        def start(machine: Machine, name: str, *words: str) -> None:
            started[name] = programs.start(machine, name, *words)

        def wait_until(is_so: Callable[[], object], what: str) -> float:
            """Waits until it is so; returns the wall time. SystemExit if a part ended; TimeoutError after `patience_s`."""
            began_s = time.monotonic()
            programs.wait_until(lambda: is_so() or ended(started), f"{what}: it took too long")
            if names := ended(started):
                raise SystemExit("\n".join(f"{what}: {it} ended: {programs.said(it)[-500:]}" for it in names))
            return time.monotonic() - began_s

        programs.start_master(one)
        whole = written(home, "whole", 1, 2 * on_each)
        start(one, "apad", *MUSSELBED, "apad", str(whole))
        wait_until(lambda: "ready" in programs.said("apad"), "no aPad")
        for name, machine in zip(FLEETS, (one, two), strict=True):
            scenario = written(home, name, ids[name].start, on_each)
            start(machine, name, *MUSSELBED, "fleet", str(scenario), "--out", f"{name}-run")
        despite = [word for it in (*DESPITE, "watchdog") for word in ("--despite", it)]
        start(one, "mission", *MUSSELBED, "mission", str(whole), "--out", "run", *despite)
        heard = Heard(programs.folder(one) / "run")

        def all_heard(name: str, since_ms: int) -> bool:
            heard.look()
            return all(heard.newest_ms.get(it, -1) >= since_ms for it in ids[name])

        heard_s = wait_until(lambda: all(all_heard(name, 0) for name in FLEETS), "not all are heard")
        before_ms, before_s = heard.now_ms, time.monotonic()
        wait_until(lambda: heard.look() or heard.now_ms >= before_ms + 60_000, "no minute passed")
        rate = (heard.now_ms - before_ms) / 1000 / (time.monotonic() - before_s)

        memory_mb = {name: pss_mb(started[name].pid) for name in (*FLEETS, "mission")}
        lose(1.0)
        cut_ms = heard.now_ms
        wait_until(
            lambda: heard.look() or heard.now_ms >= cut_ms + 1000 * CUT_S, "the mission's time stood still"
        )
        silent = {
            name: sum(heard.newest_ms[it] < heard.now_ms - 3000 * PERIOD_S for it in ids[name])
            for name in FLEETS
        }
        lose(0.0)
        healed_ms = heard.now_ms
        again_s = wait_until(lambda: all_heard(FLEETS[1], healed_ms), "the second fleet is not heard again")
        return {
            "on_each": on_each,
            "theta": THETA,
            "heard_s": heard_s,
            "rate": rate,
            "memory_mb": memory_mb,
            "cut_s": CUT_S,
            "silent": silent,
            "again_s": again_s,
            "services": heard.services,
            "ended": ended(started),
        }


def ended(started: Mapping[str, subprocess.Popen[bytes]]) -> list[str]:
    return sorted(name for name, it in started.items() if it.poll() is not None)


def pss_mb(root: int) -> float:
    """The proportional set size of a process and all that it started, in MB."""
    children = children_of_all()
    total_kb, waiting = 0, [root]
    while waiting:
        pid = waiting.pop()
        waiting += children[pid]
        try:
            rollup = Path(f"/proc/{pid}/smaps_rollup").read_text()
        except OSError:
            continue
        total_kb += next(int(it.split()[1]) for it in rollup.splitlines() if it.startswith("Pss:"))
    return total_kb / 1024


def show(result: dict[str, Any], console: Console) -> None:
    table = Table(
        title=f"{result['on_each']} aMussels on each of two machines, one mission, theta {result['theta']}"
    )
    for column in ("", "memory [MB]", f"silent after a cut of {result['cut_s']:g} s"):
        table.add_column(column, justify="left" if not column else "right")
    for name, memory_mb in result["memory_mb"].items():
        table.add_row(name, f"{memory_mb:.0f}", str(result["silent"].get(name, "")))
    console.print(table)
    console.print(
        f"all heard after {result['heard_s']:.0f} s; {result['rate']:.2f} s of mission time in a second; "
        f"the second machine's all heard again {result['again_s']:.0f} s after the link healed; "
        f"{result['services']} services"
    )
