"""Shares of several aPads in a crowded bay: planned, by the nearest start, and in the order of ids.

Five aPads of bay-120 and 60 aMussels for an hour, half of them in the fifth of the bay where the first aPad starts.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Mapping, Sequence
from math import dist
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from apad_bridge.assembly.division import divided
from apad_bridge.planning.allocation import Point, allocate
from apad_bridge.runs.in_memory import fly_in_memory
from apad_bridge.scenario.loader import from_data, load, resolve
from apad_bridge.scenario.schema import Scenario
from apad_bridge.scenario.starts import Start, save_starts, starts_of
from benchmarks.rows import told

SCENARIO = Path(__file__).parents[1] / "launch_scripts" / "scenarios" / "bay-120.yaml"
SEEDS = (1, 2)
COUNT = 60
MISSION_S, SHORT_S = 3600, 600
Division = Callable[[Sequence[Point], Mapping[int, Point]], Sequence[tuple[int, ...]]]


def nearest(starts_m: Sequence[Point], places_m: Mapping[int, Point]) -> list[tuple[int, ...]]:
    owner_of = {
        it: min(range(len(starts_m)), key=lambda n: dist(starts_m[n], at)) for it, at in places_m.items()
    }
    return [tuple(sorted(it for it in places_m if owner_of[it] == n)) for n in range(len(starts_m))]


def in_order(starts_m: Sequence[Point], places_m: Mapping[int, Point]) -> list[tuple[int, ...]]:
    parts = np.array_split(sorted(places_m), len(starts_m))
    return [tuple(int(it) for it in part) for part in parts]


DIVISIONS: dict[str, Division] = {"planned": allocate, "nearest": nearest, "in order of ids": in_order}


def measure(short: bool = False) -> dict[str, Any]:
    """Means over seeds: uptimes in percent over all aMussels and the least, metres, and the largest share."""
    seeds, mission_s = (SEEDS[:1], SHORT_S) if short else (SEEDS, MISSION_S)
    means = {}
    with tempfile.TemporaryDirectory() as folder:
        bays = [crowded(seed, Path(folder), COUNT, mission_s) for seed in seeds]
        for name, division in DIVISIONS.items():
            flights = [_flown(it, division) for it in bays]
            means[name] = {key: float(np.mean([it[key] for it in flights])) for key in flights[0]}
            told({"division": name, **means[name]})
    return means


def show(result: dict[str, Any], console: Console) -> None:
    table = Table(title=f"{COUNT} aMussels, half of them in a fifth of the bay; means over seeds")
    for column in ("", "largest share", "Avg %", "Min %", "way [m]", "emptied", "planned in [ms]"):
        table.add_column(column, justify="right" if column else "left")
    for name, it in result.items():
        keys = ("largest", "mean", "least", "cost_m", "emptied", "planned_ms")
        table.add_row(name, *(f"{it[key]:.1f}" for key in keys))
    console.print(table)


def crowded(seed: int, folder: Path, count: int, mission_s: int = MISSION_S) -> Scenario:
    """`count` aMussels with five aPads; half of them lie in a fifth of the bay, where the first aPad starts."""
    data = resolve(load(SCENARIO))
    data.update(seed=seed, duration_s=mission_s)
    data["fleet"]["count"] = count
    data["mission"]["collection"] = "cautious"
    scenario = from_data(data, "shares")
    starts = [
        Start(it.agent_id, it.north_m, it.east_m / (5 if it.agent_id <= count // 2 else 1), it.primary)
        for it in starts_of(scenario)
    ]
    path = folder / f"{seed}.csv"
    save_starts(path, starts, scenario.area.origin)
    data["fleet"]["start"] = str(path)
    return from_data(data, "shares")


def _flown(scenario: Scenario, division: Division) -> dict[str, float]:
    starts = starts_of(scenario)
    began_s = perf_counter()
    served = division(
        [scenario.apad.start_m, *(it.start_m for it in scenario.apads)],
        {it.agent_id: (it.north_m, it.east_m) for it in starts},
    )
    planned_ms = 1000 * (perf_counter() - began_s)
    flights = [(len(it.starts), fly_in_memory(it.scenario)[0]) for it in divided(scenario, starts, served)]
    return {
        "largest": max(n for n, _ in flights),
        "mean": sum(n * it["uptime_paper"]["mean"] for n, it in flights) / COUNT,
        "least": min(it["uptime_paper"]["min"] for _, it in flights),
        "cost_m": sum(it["planned_m"] for _, it in flights),
        "emptied": sum(it["emptied"] for _, it in flights),
        "planned_ms": planned_ms,
    }
