"""Strategies and rules of dispatch against the paper's, on held-out configurations; and how fast a study flies.

The rules of the comparison:

- Every parameter below was chosen on the seeds 301 to 312 and 1001 to 1006, before a seed that is flown here was drawn.
- No strategy knows when the mission ends.
- The planner's rates are the scenario's. The truth is those, and 10 and 20 % more, with boards that differ by 5 % in
  drain and in capacity. Plans are made from beliefs.
- Each rule of dispatch flies with Greedy and with Cautious too, so a gain splits into the rule's and the strategy's part.
- Differences are paired, with 95 % intervals of Student's t; the p-values are adjusted by Holm, over all differences of
  a setting.

The goals are differences to Cautious with the paper's batches; metres are compared with Greedy's, with those batches.
"""

from __future__ import annotations

import os
import resource
import tempfile
import time
from pathlib import Path
from statistics import fmean
from typing import Any

from rich.console import Console
from rich.table import Table

from apad_bridge.runs.studies.capacity import bounds_of
from apad_bridge.runs.studies.runner import Row, fly_study
from apad_bridge.runs.studies.specification import Plan, plan_of
from apad_bridge.runs.studies.statistics import holm, standings

SCENARIOS = Path(__file__).parents[1] / "launch_scripts/scenarios"
MISSIONS = 1200
STRATEGIES = ["greedy", "cautious", "blend"]
"""All with Greedy Redeploy and the paper's batches; the blend weighs a battery as 1 m."""
FIRST_HELD_OUT = 20_001
COSTS = {"distance_per_m": 1.0, "energy_per_charge": 100.0}
"""A battery is worth 100 m."""
ASYNCHRONOUS = {"dispatch": "asynchronous"}
PARTIAL = {"dispatch": "asynchronous", "pool_threshold": 0.45, "charge_to": 0.75}
COMPARED: list[dict[str, Any]] = [
    {"name": "cautious", "collection": "cautious"},
    {"name": "greedy", "collection": "greedy"},
    {"name": "rollout", "collection": "rollout", "costs": COSTS},
    {"name": "rollout-fair", "collection": "rollout-fair", "costs": COSTS},
    {"name": "cautious, asynchronous", "collection": "cautious", **ASYNCHRONOUS},
    {"name": "greedy, asynchronous", "collection": "greedy", **ASYNCHRONOUS},
    {"name": "rollout-fair, asynchronous", "collection": "rollout-fair", "costs": COSTS, **ASYNCHRONOUS},
    {"name": "cautious, partial", "collection": "cautious", **PARTIAL},
    {"name": "greedy, partial", "collection": "greedy", **PARTIAL},
    {"name": "rollout-fair, partial", "collection": "rollout-fair", "costs": COSTS, **PARTIAL},
]
TRUTHS: dict[str, dict[str, float]] = {
    "as the planner assumes": {},
    "10 % more": {"drain_bias": 0.1, "drain": 0.05, "capacity": 0.05},
    "20 % more": {"drain_bias": 0.2, "drain": 0.05, "capacity": 0.05},
}
FIGURES = ("uptime_paper_mean", "uptime_paper_min", "metres")


def measure(tries: int = 200) -> dict[str, Any]:
    """The start of the processes counts. On a busy machine the missions a second of processor time say more."""
    workers = len(os.sched_getaffinity(0))
    speed_plan = plan_of(
        {
            "name": "planner",
            "scenarios": ["pool-12.yaml"],
            "strategies": STRATEGIES,
            "seeds": MISSIONS // len(STRATEGIES),
        },
        "planner",
        SCENARIOS,
    )
    load_before = os.getloadavg()[0]
    rows, took_s, cpu_s = _flown(speed_plan, workers)
    return {
        "missions": len(rows),
        "took_s": took_s,
        "missions_per_s": len(rows) / took_s,
        "missions_per_cpu_s": len(rows) / cpu_s,
        "processes": workers,
        "load_before": load_before,
        "configurations": tries,
        "comparisons": [
            _compared(file, truth, tries, workers)
            for file in ("pool-12.yaml", "bay-24.yaml")
            for truth in TRUTHS
        ],
    }


def _compared(file: str, truth: str, tries: int, workers: int) -> dict[str, Any]:
    study = {
        "name": "planner",
        "scenarios": [file],
        "strategies": COMPARED,
        "seeds": list(range(FIRST_HELD_OUT, FIRST_HELD_OUT + tries)),
        "parameters": {f"fleet.spread.{key}": [value] for key, value in TRUTHS[truth].items()},
        "primary": "uptime_paper_mean",
    }
    plan = plan_of(study, "planner", SCENARIOS)
    rows, took_s, _ = _flown(plan, workers)
    found = standings(rows, plan.strategies, "cautious", "uptime_paper_mean", 0.95)
    figures = {}
    for standing in found:
        means = {key: estimate.mean for key in FIGURES if (estimate := standing.columns[key])}
        differences = {
            key: [it.estimate.mean, it.estimate.low, it.estimate.high]
            for key in FIGURES
            if (it := standing.differences.get(key))
        }
        figures[standing.strategy] = {"means": means, "differences": differences}
    # The study adjusts each pair by itself; these are adjusted over all pairs and figures of the setting.
    pairs = [
        (standing.strategy, key, _p_of(rows, standing.strategy, key))
        for standing in found
        if standing.differences
        for key in FIGURES
    ]
    for (name, key, _), p in zip(pairs, holm([p for _, _, p in pairs]), strict=True):
        figures[name].setdefault("p", {})[key] = p
    greedy_m = fmean(row["metres"] for row in rows if row["strategy"] == "greedy")
    for name in figures:
        figures[name]["metres_of_greedy"] = figures[name]["means"]["metres"] / greedy_m
    bound = bounds_of([plan.scenario(0, 0, seed) for seed in plan.seeds])
    return {
        "scenario": file,
        "truth": truth,
        "took_s": took_s,
        "uptime_bound": bound.uptime_percent,
        "strategies": figures,
    }


def _p_of(rows: list[Row], strategy: str, column: str) -> float:
    from scipy.stats import ttest_rel

    ours, theirs = (
        [row[column] for row in sorted(rows, key=lambda it: it["seed"]) if row["strategy"] == name]
        for name in (strategy, "cautious")
    )
    return float(ttest_rel(ours, theirs).pvalue)


def _flown(plan: Plan, workers: int) -> tuple[list[Row], float, float]:
    """The rows, and the seconds by the clock and of processors."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    with tempfile.TemporaryDirectory() as directory:
        began_s = time.perf_counter()
        rows = fly_study(plan, Path(directory) / "study", workers)
        took_s = time.perf_counter() - began_s
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return rows, took_s, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def show(result: dict[str, Any], console: Console) -> None:
    console.print(
        f"{result['missions']} missions in {result['took_s']:.1f} s: {result['missions_per_s']:.1f} a second with "
        f"{result['processes']} processes, {result['missions_per_cpu_s']:.1f} a second of processor time"
    )
    for compared in result["comparisons"]:
        table = Table(
            title=f"{compared['scenario']}, truth {compared['truth']}: {result['configurations']} configurations; "
            f"nobody exceeds {compared['uptime_bound']:.1f} % uptime"
        )
        for name in ("", "uptime %", "less Cautious", "least %", "less Cautious", "metres", "of Greedy"):
            table.add_column(name, justify="left" if not name else "right")
        for name, figures in compared["strategies"].items():
            means, differences = figures["means"], figures["differences"]
            table.add_row(
                name,
                f"{means['uptime_paper_mean']:.2f}",
                _difference(differences.get("uptime_paper_mean"), figures, "uptime_paper_mean"),
                f"{means['uptime_paper_min']:.1f}",
                _difference(differences.get("uptime_paper_min"), figures, "uptime_paper_min"),
                f"{means['metres']:.0f}",
                f"{figures['metres_of_greedy']:.0%}",
            )
        console.print(table)


def _difference(estimate: list[float] | None, figures: dict[str, Any], key: str) -> str:
    if estimate is None:
        return ""
    mean, low, high = estimate
    return f"{mean:+.2f} +- {(high - low) / 2:.2f}" + ("" if figures["p"][key] < 0.05 else " (n.s.)")
