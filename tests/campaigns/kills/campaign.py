"""Kills of real runs: random processes by SIGKILL, SIGTERM and SIGSTOP, then the machine's power, a resume, and an end.

A try draws a mix by its seed (`mixes.py`) and flies it on a machine of its own, which is a namespace (`machine.py`).
At the end `musselbed check` must find nothing, and neither must a judge that reads the records by hand (`judge.py`).
Nothing is left over, and no program has a traceback. DIR/failed keeps the records of a failed try.
"""

from __future__ import annotations

import random
import shutil
import tempfile
from pathlib import Path
from typing import Any

from tries import Job, Kept, NoFlight, Result, fly_all, in_cells, in_turns

from kills.flight import ROOT, Flight
from kills.judge import Ending, judge
from kills.machine import DISK, why_no_machine
from kills.mixes import ROWS, drawn
from kills.records import records_of

SEED = 20261128
TRIES = 10
SIDE_BY_SIDE = 2


def measure(
    tries: int = TRIES,
    row: list[str] | None = None,
    generation: list[str] | None = None,
    side_by_side: int = SIDE_BY_SIDE,
    resume: Path | None = None,
) -> dict[str, Any]:
    """So many tries of each row and generation."""
    if why := why_no_machine(ROOT):
        raise SystemExit(f"a machine whose power goes cannot be simulated: {why}")
    if unknown := [it for it in row or () if it not in ROWS]:
        raise SystemExit(f"no such row: {', '.join(unknown)}; rows: {', '.join(ROWS)}")
    chosen = in_turns(
        [
            (name, it, tries)
            for name in row or ROWS
            for it in ROWS[name].generations
            if it in (generation or ("a", "b"))
        ]
    )
    with tempfile.TemporaryDirectory(prefix="musselbed-campaign-") as folder:
        kept = Kept(resume or Path(folder))
        fly_all(
            chosen,
            kept,
            side_by_side,
            lambda job, attempt: flown(job, kept),
            lambda it: ", ".join(it["acts"]),
        )
    return {
        "rows": [summary(*cell, results) for cell, results in in_cells(chosen, kept).items()],
        "not_tried": {},
    }


def flown(job: Job, kept: Kept) -> Result:
    seed = f"{SEED} {job.row} {job.generation} {job.number}"
    home = Path(tempfile.mkdtemp(prefix="musselbed-kills-", dir=DISK))
    flight = Flight(
        home, ROWS[job.row], drawn(job.row, job.generation, seed), random.Random(seed), kept.ended
    )
    try:
        flight.fly()
        failures = [*flight.failures, *flight.tracebacks(), *flight.check()]
        is_over = flight.was_resumed or not flight.lost_power
        for run in flight.run_dirs:
            ending = Ending(flight.code, flight.said, is_over, flight.row.clock)
            failures += [f"{run.name}: {it}" for it in judge(records_of(run), ending)]
        if failures:
            shutil.copytree(home, kept.folder / "failed" / job.name, ignore=_sockets, dirs_exist_ok=True)
        return {
            "failures": failures[:20],
            "acts": flight.done,
            "resumed": flight.was_resumed,
            "code": flight.code,
        }
    except (NoFlight, TimeoutError, OSError):
        if not kept.ended.is_set():
            shutil.copytree(home, kept.folder / "not-begun" / job.name, ignore=_sockets, dirs_exist_ok=True)
        raise
    finally:
        shutil.rmtree(home, ignore_errors=True)


def _sockets(folder: str, names: list[str]) -> list[str]:
    return [it for it in names if (Path(folder) / it).is_socket()]


def summary(name: str, generation: str, results: list[Result]) -> Result:
    """One line of the table."""
    flown = [it for it in results if "error" not in it]
    return {
        "row": name,
        "generation": generation,
        "tries": len(flown),
        "good": sum(not it["failures"] for it in flown),
        "resumed": sum(it["resumed"] for it in flown),
        "kills": sum(len(it["acts"]) for it in flown),
        "errors": len(results) - len(flown),
        "failures": [f"try {it['try']}: {why}" for it in flown for why in it["failures"][:3]],
    }
