"""Ten days of the aMussels' time: aMussels lost, samples and metres with free and with costly surfacing, beside the law.

- Each with free surfacing, as the paper's, and with 2, 5 and 9 % of a battery for a surfacing and a sinking.
- Theta 30 with the pool's 12 aMussels; theta 1 with as many as the law of capacity allows, and one fewer and one more. An
  aMussel that was ever empty was not sustained, so the measured capacity is the largest fleet without a dead hour.
- The aPad's energy is unlimited, and its figures stand at theta 1 alone.

A run that is ended goes on from `studies/ten-days-*` below the present directory with the same command.
"""

from __future__ import annotations

import os
import resource
import time
from dataclasses import asdict
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

from apad_bridge.runs.studies.capacity import bounds_of
from apad_bridge.runs.studies.figures import COLUMNS
from apad_bridge.runs.studies.report import HEADINGS
from apad_bridge.runs.studies.runner import fly_study
from apad_bridge.runs.studies.specification import Plan, plan_of
from apad_bridge.runs.studies.statistics import standings

SCENARIOS = Path(__file__).parents[1] / "launch_scripts/scenarios"
TEN_DAYS_S = 10 * 86_400
SURFACINGS = (0.0, 0.02, 0.05, 0.09)
"""Parts of a battery for a surfacing and a sinking together."""
UNLIMITED_WH = 1e6
STRATEGIES: list[dict[str, Any]] = [
    {"name": "cautious, batch", "collection": "cautious"},
    {
        "name": "cautious, from the knee",
        "collection": "cautious",
        "dispatch": "asynchronous",
        "pool_threshold": 0.62,
    },
    {
        "name": "cautious, partial",
        "collection": "cautious",
        "dispatch": "asynchronous",
        "pool_threshold": 0.8,
        "charge_to": 0.9,
    },
]
"""The pool's charging curve is fastest above its knee at 0.56. No parameter was chosen on the seeds flown here."""
FIRST_HELD_OUT = 20_001
ENOUGH = 200


def measure(tries: int = 1) -> dict[str, Any]:
    """Flies `tries` configurations of each setting; `hours_for_enough` is how long 200 take on these processors."""
    workers = len(os.sched_getaffinity(0))
    before, began_s = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    settings, flown = [], 0
    for plan in plans(tries):
        told: list[int] = []
        rows = fly_study(plan, Path("studies") / plan.study.name, workers, told.append)
        flown += sum(told[1:])  # the first call tells of the missions that were there
        for index, setting in enumerate(plan.settings):
            own = [row for row in rows if row["setting"] == index]
            bounds = bounds_of([plan.scenario(index, 0, seed) for seed in plan.seeds])
            found = standings(own, plan.strategies, plan.baseline, "amussels_lost", 0.95)
            settings.append({"setting": setting.label, "bounds": asdict(bounds), "strategies": _means(found)})
    after, took_s = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter() - began_s
    cpu_s = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return {
        "configurations": tries,
        "missions_flown_now": flown,
        "took_s": took_s,
        "hours_for_enough": cpu_s / flown * ENOUGH * len(settings) * len(STRATEGIES) / workers / 3600
        if flown
        else None,
        "settings": settings,
    }


def plans(tries: int) -> list[Plan]:
    """A study for theta 30, and one at theta 1 for each energy of surfacing, with fleets about what its law allows."""
    found = [_plan("ten-days-theta30", 30, SURFACINGS, [12], tries)]
    for surfacing in SURFACINGS:
        law = _plan("law", 1, [surfacing], [24], 1)
        allowed = int(bounds_of([law.scenario(0, 0, FIRST_HELD_OUT)]).sustained)
        name = f"ten-days-theta1-{round(100 * surfacing)}"
        found.append(_plan(name, 1, [surfacing], [allowed - 1, allowed, allowed + 1], tries))
    return found


def _plan(name: str, theta: int, surfacings: Any, counts: list[int], tries: int) -> Plan:
    study = {
        "name": name,
        "scenarios": ["pool-12.yaml"],
        "strategies": STRATEGIES,
        "seeds": list(range(FIRST_HELD_OUT, FIRST_HELD_OUT + tries)),
        "parameters": {
            "theta": [theta],
            "duration_s": [TEN_DAYS_S / theta],
            "apad.battery.capacity_wh": [UNLIMITED_WH],
            "fleet.count": counts,
            "board.motor_run_charge": [it / 2 for it in surfacings],
        },
        "primary": "amussels_lost",
    }
    return plan_of(study, name, SCENARIOS)


def _means(found: Any) -> dict[str, dict[str, float | None]]:
    return {
        it.strategy: {key: None if (mean := it.columns[key]) is None else mean.mean for key in COLUMNS}
        for it in found
    }


def show(result: dict[str, Any], console: Console) -> None:
    if result["hours_for_enough"] is not None:
        console.print(
            f"{result['missions_flown_now']} missions in {result['took_s']:.0f} s; {ENOUGH} configurations of each setting "
            f"take {result['hours_for_enough']:.1f} h"
        )
    for setting in result["settings"]:
        table = Table(title=f"{setting['setting']}: the docks sustain {setting['bounds']['sustained']:.1f}")
        for name in ("", *(HEADINGS[key] for key in COLUMNS)):
            table.add_column(name, justify="right" if name else "left")
        for name, means in setting["strategies"].items():
            cells = ("–" if (mean := means[key]) is None else f"{mean:.4g}" for key in COLUMNS)
            table.add_row(name, *cells)
        console.print(table)
