"""The worth of aPads taking over from each other: one of five aPads fails in the first minutes of an hour.

Flown in a bay where five aPads have room for more work, and in one where they have far too much already.
"""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from apad_bridge.assembly.division import members
from apad_bridge.runs.several.in_memory import open_lockstep
from apad_bridge.scenario.loader import from_data, resolve
from apad_bridge.scenario.schema import Scenario
from apad_bridge.scenario.starts import starts_of
from benchmarks.rows import told
from benchmarks.shares import MISSION_S, crowded

SEEDS = (1, 2)
COUNTS = (25, 60)
SHORT_S = 600
BATTERY = 0.01
"""The charge of the third aPad's battery at the start."""


def measure(short: bool = False) -> dict[str, Any]:
    """Means over seeds by "count, how": uptimes in percent over all aMussels and the least, metres, services."""
    results = {}
    seeds, mission_s = (SEEDS[:1], SHORT_S) if short else (SEEDS, MISSION_S)
    with tempfile.TemporaryDirectory() as folder:
        for count in COUNTS:
            for transfers in (True, False):
                flights = [_flown(crowded(seed, Path(folder), count, mission_s), transfers) for seed in seeds]
                name = f"{count}, {'taken over' if transfers else 'left alone'}"
                results[name] = {key: float(np.mean([it[key] for it in flights])) for key in flights[0]}
                told({"name": name, **results[name]})
    return results


def show(result: dict[str, Any], console: Console) -> None:
    table = Table(title="one of five aPads fails; means over seeds")
    for column in ("aMussels", "Avg %", "Min %", "way [m]", "emptied", "served", "handed on"):
        table.add_column(column, justify="left" if column == "aMussels" else "right")
    for name, it in result.items():
        keys = ("mean", "least", "cost_m", "emptied", "services", "handed_on")
        table.add_row(name, *(f"{it[key]:.1f}" for key in keys))
    console.print(table)


def _flown(scenario: Scenario, transfers: bool) -> dict[str, float]:
    data = resolve(scenario)
    data["apads"][1]["battery_start_fraction"] = BATTERY
    data["sharing"]["transfers"] = transfers
    failing = from_data(data, "taking over")
    opened = open_lockstep(members(failing, starts_of(failing)), failing.sharing)
    opened.runner.run()
    figures = opened.figures().values()
    counted_s = sum(it["counted_s"] for it in figures)
    return {
        "mean": sum(it["counted_s"] * it["uptime_paper"]["mean"] for it in figures) / counted_s,
        "least": min(it["uptime_paper"]["min"] for it in figures),
        "cost_m": sum(it["planned_m"] for it in figures),
        "emptied": sum(it["emptied"] for it in figures),
        "services": sum(it["services"] for it in figures),
        "handed_on": opened.runner.handed_on_count,
    }
