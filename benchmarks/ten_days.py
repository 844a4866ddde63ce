"""Ten days of the aMussels' time: aMussels lost, samples and metres with free and with costly surfacing, beside the law.

- Each with free surfacing, as the paper's, and with 2, 5 and 9 % of a battery for a surfacing and a sinking.
- Theta 30 with the pool's 12 aMussels; theta 1 with the fleets about what the law of capacity allows. An aMussel that was
  ever empty was not sustained, so the measured capacity is the largest fleet without a dead hour.
- The aPad's energy is unlimited, and its figures stand at theta 1 alone.

A run that is ended goes on from `studies/ten-days-*` below the present directory with the same command.
"""

from __future__ import annotations

import os
import resource
import time
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

from apad_bridge.runs.studies.figures import COLUMNS
from apad_bridge.runs.studies.report import HEADINGS, as_data, comparisons
from apad_bridge.runs.studies.runner import fly_study
from apad_bridge.runs.studies.specification import Plan, plan_of

SCENARIOS = Path(__file__).parents[1] / "launch_scripts/scenarios"
TEN_DAYS_S = 10 * 86_400
SURFACINGS = (0.0, 0.02, 0.05, 0.09)
"""Parts of a battery for a surfacing and a sinking together."""
FLEETS = [12, 13, 14, 15]
"""The law allows 15.2 with free surfacing, and 14.7, 13.9 and 12.9 with the others."""
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
        "pool_threshold": 0.7,
        "charge_to": 0.95,
    },
]
"""The pool's charging curve is fastest above its knee at 0.56. The parameters were chosen on the seeds 301 and 302."""
FIRST_HELD_OUT = 20_001
ENOUGH = 200


def measure(tries: int = 1) -> dict[str, Any]:
    """Flies `tries` configurations of each setting; `hours_for_enough` is how long 200 take on these processors."""
    workers = len(os.sched_getaffinity(0))
    before, began_s = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    settings, flown, wanted = [], 0, 0
    for plan in plans(tries):
        told: list[int] = []
        rows = fly_study(plan, Path("studies") / plan.study.name, workers, told.append)
        flown += sum(told[1:])  # the first call tells of the missions that were there
        wanted += plan.missions // tries * ENOUGH
        settings += as_data(plan, comparisons(plan, rows))["settings"]
    after, took_s = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter() - began_s
    cpu_s = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return {
        "configurations": tries,
        "missions_flown_now": flown,
        "took_s": took_s,
        "hours_for_enough": cpu_s / flown * wanted / workers / 3600 if flown else None,
        "settings": settings,
    }


def plans(tries: int) -> list[Plan]:
    """A study for theta 30, and one at theta 1. All missions of a seed share its drift, which is most of their time."""
    return [
        _plan("ten-days-theta30", 30, [12], tries),
        _plan("ten-days-theta1", 1, FLEETS, tries),
    ]


def _plan(name: str, theta: int, counts: list[int], tries: int) -> Plan:
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
            "board.motor_run_charge": [it / 2 for it in SURFACINGS],
        },
        "primary": "samples_taken",
    }
    return plan_of(study, name, SCENARIOS)


def show(result: dict[str, Any], console: Console) -> None:
    console.print(f"{result['configurations']} configurations, means with 95 % intervals")
    if result["hours_for_enough"] is not None:
        console.print(
            f"{result['missions_flown_now']} missions in {result['took_s']:.0f} s; {ENOUGH} configurations of each setting "
            f"take {result['hours_for_enough']:.1f} h"
        )
    for setting in result["settings"]:
        bounds = setting["bounds"]
        table = Table(
            title=f"{setting['setting']}: the docks sustain {bounds['sustained']:.1f}, nobody exceeds "
            f"{bounds['samples']:.0f} samples and {bounds['uptime_percent']:.1f} % uptime"
        )
        for name in ("", *(HEADINGS[key] for key in COLUMNS)):
            table.add_column(name, justify="right" if name else "left")
        for standing in setting["strategies"]:
            table.add_row(standing["strategy"], *(_cell(standing["columns"][key]) for key in COLUMNS))
        console.print(table)


def _cell(estimate: dict[str, Any] | None) -> str:
    if estimate is None:
        return "–"
    half = "" if estimate["high"] is None else f" +- {estimate['high'] - estimate['mean']:.2g}"
    return f"{estimate['mean']:.4g}{half}"
