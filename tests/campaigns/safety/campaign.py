"""Faults of a vehicle at sea: seconds to the first stop on the wire, and orders that should not have come, judged outside.

Real processes fly `real-apad.yaml` over two machines that are network namespaces, a minute for each try. A relay falsifies
what the bench and the watchdog hear, while the hull keeps its true position. The judge reads the packets at the vehicle's
computer, computes fence and stops by its own geometry from the true position, and imports no module of what it judges
(`wire.py`, `judge.py`). The rows, and what each owes, are in `rows.py`.

DIR/failed has what the wire and the programs of a failed try said. `--short` flies the most important rows twice.
`--minutes` is the length of a healthy flight, in which nobody may stop the vehicle.
"""

from __future__ import annotations

import random
import shutil
import statistics
import tempfile
from contextlib import ExitStack
from dataclasses import asdict
from pathlib import Path
from typing import Any

from older_pythons import NoOlderPython, older_python
from tries import Job, Kept, NoFlight, Result, fly_all, in_cells, in_turns
from two_machines import why_no_two_machines

from safety.flight import Flight
from safety.judge import Case, joined, judge
from safety.row import BOTH, SHORT_TRIES, Try
from safety.rows import COUNTERPARTS, ROWS

COUNTERPART = "counterpart"
"""In the place of a generation: a stranger's vehicle of generation B (tests/counterparts), which flies when asked for."""
SEED = 20261124
MINUTES = 300.0
"""Two rows and two generations of healthy flight: twenty hours."""
LONGER_S = 600.0
"""The mission lasts so much longer than the row's --minutes."""
SIDE_BY_SIDE = 2
KEPT = ("wire.out", "run-*.out", "resume-*.out", "caller-*.out", "watchdog-*.out", "hull-*.out")


def measure(
    tries: int | None = None,
    minutes: float = MINUTES,
    short: bool = False,
    row: list[str] | None = None,
    generation: list[str] | None = None,
    side_by_side: int = SIDE_BY_SIDE,
    resume: Path | None = None,
) -> dict[str, Any]:
    """Each row for each generation: counts are sums over the tries, times are the median and the longest."""
    if why := why_no_two_machines():
        raise SystemExit(f"two machines on one cannot be: {why}")
    if unknown := [it for it in row or () if it not in ROWS]:
        raise SystemExit(f"no such row: {', '.join(unknown)}; rows: {', '.join(ROWS)}")
    chosen = jobs(row or [], generation or list(BOTH), tries, short=short)
    if any(ROWS[it.row].setup.clock_off_s for it in chosen) and shutil.which("faketime") is None:
        raise SystemExit(
            "a vehicle whose clock is off needs faketime: install Debian's package, or name other rows (--row)"
        )
    chosen, without = _with_their_pythons(chosen)
    with tempfile.TemporaryDirectory(prefix="musselbed-campaign-") as folder:
        kept = Kept(resume or Path(folder))
        fly_all(chosen, kept, side_by_side, lambda job, attempt: flown(job, attempt, kept, minutes), figures)
    cells = in_cells(chosen, kept)
    not_tried = {
        f"{name}, generation {gen}": ROWS[name].why_not
        for name in dict.fromkeys(name for name, _ in cells)
        for gen in BOTH
        if gen not in ROWS[name].generations
    } | without
    return {"rows": [summary(*cell, results) for cell, results in cells.items()], "not_tried": not_tried}


def jobs(rows: list[str], generations: list[str], tries: int | None, *, short: bool) -> list[Job]:
    """Each try of the chosen rows."""
    return in_turns(
        [
            (name, generation, tries or (SHORT_TRIES if short else row.tries))
            for name, row in ROWS.items()
            if (name in rows if rows else row.is_short or not short)
            for generation in (*row.generations, *([COUNTERPART] if name in COUNTERPARTS else []))
            if generation in generations
        ]
    )


def _with_their_pythons(chosen: list[Job]) -> tuple[list[Job], dict[str, str]]:
    """The jobs whose watchdog's Python this machine has, and for the other rows the reason."""
    missing: dict[str, str] = {}
    for version in {ROWS[it.row].setup.watchdog_python for it in chosen} - {""}:
        try:
            older_python(version)
        except NoOlderPython as error:
            missing[version] = str(error)
    flown = [it for it in chosen if ROWS[it.row].setup.watchdog_python not in missing]
    versions = {it.row: ROWS[it.row].setup.watchdog_python for it in chosen}
    return flown, {row: missing[version] for row, version in versions.items() if version in missing}


def flown(job: Job, attempt: int, kept: Kept, minutes: float) -> Result:
    row = ROWS[job.row]
    rng = random.Random(f"{SEED} {job.row} {job.generation} {job.number} {attempt}")
    home = Path(tempfile.mkdtemp(prefix="musselbed-safety-"))
    try:
        with ExitStack() as stack:
            is_counterpart = job.generation == COUNTERPART
            generation = "b" if is_counterpart else job.generation
            duration_s = 60 * minutes + LONGER_S
            flight = Flight(home, generation, rng, row.setup, stack, duration_s, is_counterpart, kept.ended)
            flight.begin()
            flight.pause(rng.uniform(0.0, 3.0))
            judged = row.act(Try(flight, job.number, minutes))
            cases = {"apad1": judged} if isinstance(judged, Case) else judged
            verdict = joined({name: judge(flight.look(name.split(",")[0]), it) for name, it in cases.items()})
            despite = flight.despite
        if verdict.failures:
            _keep(home, kept.folder / "failed" / job.name)
        return asdict(verdict) | {"despite": despite}
    except (NoFlight, TimeoutError, OSError):
        _keep(home, kept.folder / "not-begun" / job.name)
        raise
    finally:
        shutil.rmtree(home, ignore_errors=True)


def _keep(home: Path, target: Path) -> None:
    """Keeps the output of the wire, the bench and the vehicle's programs, which shows the cause of a failure."""
    target.mkdir(parents=True, exist_ok=True)
    for path in (it for pattern in KEPT for it in home.glob(pattern)):
        shutil.copy(path, target)


def figures(result: Result) -> str:
    return f"stop {_figure(result['stop_s'])} s, coasting {_figure(result['coasting_m'])} m"


def _figure(value: float | None) -> str:
    return "-" if value is None else f"{value:g}"


def summary(name: str, generation: str, results: list[dict[str, Any]]) -> dict[str, Any]:
    """One cell of the table. `never` counts the tries without a stop where one was due."""
    flown = [it for it in results if "error" not in it]
    stops_s = [it["stop_s"] for it in flown if it["stop_s"] is not None]
    coasting_m = [it["coasting_m"] for it in flown if it["coasting_m"] is not None]
    return {
        "row": name,
        "generation": generation,
        "tries": len(flown),
        "good": sum(not it["failures"] for it in flown),
        "stop_s": round(statistics.median(stops_s), 1) if stops_s else None,
        "longest_s": max(stops_s, default=None),
        "never": sum(any("on the wire" in why for why in it["failures"]) for it in flown),
        "outside": sum(it["outside"] for it in flown),
        "against_pilot": sum(it["against_pilot"] for it in flown),
        "unasked": sum(it["unasked"] for it in flown),
        "told_untaken": sum(it["untaken"] for it in flown),
        "answer_s": max((it["answer_s"] for it in flown if it["answer_s"] is not None), default=None),
        "nuisances": sum(it["nuisances"] for it in flown),
        "coasting_m": max(coasting_m, default=None),
        "furthest_out_m": max((it["furthest_out_m"] for it in flown), default=None),
        "errors": len(results) - len(flown),
        "despite": sorted({check for it in flown for check in it["despite"]}),
        "failures": list(dict.fromkeys(why for it in flown for why in it["failures"]))[:5],
    }
