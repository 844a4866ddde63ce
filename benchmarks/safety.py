"""Faults of a vehicle at sea: seconds to the first stop on the wire, and orders that should not have come, judged outside.

Real processes fly `real-apad.yaml` over two machines that are network namespaces, a minute for each try. A relay falsifies
what the bench and the watchdog hear, while the hull keeps its true position. The judge reads the packets at the vehicle's
computer, computes fence and stops by its own geometry from the true position, and imports no module of what it judges
(`safety_study/wire.py`, `safety_study/judge.py`). The rows, and what each owes, are in `safety_study/rows.py`.

The campaign takes hours: `--resume DIR` keeps each try in DIR/tries.jsonl as it comes, and goes on from there. DIR/failed
has what the wire and the programs of a failed try said. `--short` flies the most important rows twice; `--row` and
`--generation` choose. `--minutes` is the length of a healthy flight, in which nobody may stop the vehicle.
"""

from __future__ import annotations

import shutil
import statistics
import tempfile
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table
from two_machines import why_no_two_machines

from benchmarks.safety_study.campaign import Kept, fly, jobs
from benchmarks.safety_study.rows import BOTH, ROWS

MINUTES = 300.0
"""Two rows and two generations of healthy flight: twenty hours."""
SIDE_BY_SIDE = 2


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
    with tempfile.TemporaryDirectory(prefix="musselbed-campaign-") as folder:
        kept = Kept(resume or Path(folder))
        fly(chosen, kept, side_by_side, minutes)
    wanted = {(it.row, it.generation, it.number) for it in chosen}
    results = [it for it in kept.results if (it["row"], it["generation"], it["try"]) in wanted]
    cells = dict.fromkeys(
        (it.row, it.generation) for it in sorted(chosen, key=lambda it: list(ROWS).index(it.row))
    )
    rows = [
        summary(name, gen, [it for it in results if (it["row"], it["generation"]) == (name, gen)])
        for name, gen in cells
    ]
    not_tried = {
        f"{name}, generation {gen}": ROWS[name].why_not
        for name in dict.fromkeys(name for name, _ in cells)
        for gen in BOTH
        if gen not in ROWS[name].generations
    }
    return {"rows": rows, "not_tried": not_tried}


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


def show(result: dict[str, Any], console: Console) -> None:
    names = [it for it in result["rows"][0] if it not in ("failures", "despite")]
    table = Table(*(name.replace("_", " ") for name in names))
    for row in result["rows"]:
        table.add_row(*("-" if row[name] is None else str(row[name]) for name in names))
    console.print(table)
    for row in result["rows"]:
        cell = f"{row['row']}, {row['generation']}"
        for why in row["failures"]:
            console.print(f"{cell}: {why}", markup=False)
        if row["despite"]:
            console.print(f"{cell}: flown despite these checks of the preflight: {', '.join(row['despite'])}")
    for what, why in result["not_tried"].items():
        console.print(f"not tried: {what}: {why}")
