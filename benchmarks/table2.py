"""Cautious collection on 200 random configurations beside the paper's Table II: the percentiles of the paper's values."""

from __future__ import annotations

import statistics
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.progress import track
from rich.table import Table

from apad_bridge.runs.studies.table_two import PAPER_CAUTIOUS, configurations, percentile_of
from apad_bridge.scenario.loader import load

COUNT = 200
SCENARIO = Path(__file__).parents[1] / "launch_scripts/scenarios/pool-12.yaml"


def measure() -> dict[str, Any]:
    """One row a column of Table II; the paper's Greedy rows contradict themselves and are not compared."""
    flown = track(
        configurations(load(SCENARIO), COUNT),
        "flying",
        total=COUNT,
        console=Console(stderr=True),
        transient=True,
    )
    flights = list(flown)
    rows = []
    for key, paper in PAPER_CAUTIOUS.items():
        values = sorted(flight[key] for flight in flights)
        rows.append(
            {
                "column": key,
                "paper": paper,
                "p5": values[int(0.05 * COUNT)],
                "median": statistics.median(values),
                "p95": values[int(0.95 * COUNT)],
                "sd": statistics.stdev(values),
                "percentile_of_paper": percentile_of(paper, values),
            }
        )
    return {"configurations": COUNT, "strategy": "cautious", "rows": rows}


def show(result: dict[str, Any], console: Console) -> None:
    table = Table(title=f"Cautious, {result['configurations']} random configurations of the pool")
    for name in ("", "paper", "5 %", "median", "95 %", "sd", "paper's percentile"):
        table.add_column(name, justify="left" if not name else "right")
    for row in result["rows"]:
        table.add_row(
            row["column"],
            *(f"{row[key]:.2f}" for key in ("paper", "p5", "median", "p95", "sd")),
            f"{row['percentile_of_paper']:.0f}",
        )
    console.print(table)
