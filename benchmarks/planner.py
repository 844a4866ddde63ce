"""Strategies and rules of dispatch against the paper's, on held-out configurations; and how fast a study flies.

The rules of the comparison:

- Every parameter below was chosen on the seeds 301 to 312 and 1001 to 1006, and on no seed that is flown here.
- No strategy knows when the mission ends.
- The planner's rates are the scenario's. The truth is those, and 10 and 20 % more, with boards that differ by 5 % in
  drain and in capacity. Plans are made from beliefs. Surfacing is free, or takes 2, 5 or 9 % of a battery.
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
from functools import partial
from pathlib import Path
from random import Random
from statistics import fmean
from typing import Any

from distributed import LocalCluster
from rich.console import Console
from rich.table import Table

from apad_bridge.assembly.energy_model import energy_model
from apad_bridge.planning import registry
from apad_bridge.planning.candidates import Candidate, Situation
from apad_bridge.planning.costs import CostScales
from apad_bridge.runs.studies.capacity import bounds_of
from apad_bridge.runs.studies.dask_cluster import fly_on_dask
from apad_bridge.runs.studies.figures import COLUMNS
from apad_bridge.runs.studies.runner import Row, fly_study
from apad_bridge.runs.studies.specification import Plan, plan_of
from apad_bridge.runs.studies.statistics import holm, standings
from apad_bridge.scenario.loader import load

SCENARIOS = Path(__file__).parents[1] / "launch_scripts/scenarios"
MISSIONS = 1200
STRATEGIES = ["greedy", "cautious", "blend"]
"""All with Greedy Redeploy and the paper's batches; the blend weighs a battery as 1 m."""
FIRST_HELD_OUT = 20_001
COSTS = {"distance_per_m": 1.0, "energy_per_charge": 100.0}
"""A battery is worth 100 m."""
ASYNCHRONOUS = {"dispatch": "asynchronous"}
PARTIAL = {"dispatch": "asynchronous", "pool_threshold": 0.45, "charge_to": 0.75}
PARTIAL_BATCH = {"pool_threshold": 0.6, "charge_to": 0.9}
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
    {"name": "cautious, partial batch", "collection": "cautious", **PARTIAL_BATCH},
    {"name": "rollout-fair, partial batch", "collection": "rollout-fair", "costs": COSTS, **PARTIAL_BATCH},
]
SURFACING = "board.motor_run_charge"
CONDITIONS: dict[str, dict[str, Any]] = {
    "as the planner assumes": {},
    "10 % more drain": {
        "fleet.spread.drain_bias": 0.1,
        "fleet.spread.drain": 0.05,
        "fleet.spread.capacity": 0.05,
    },
    "20 % more drain": {
        "fleet.spread.drain_bias": 0.2,
        "fleet.spread.drain": 0.05,
        "fleet.spread.capacity": 0.05,
    },
    "2 % a surfacing": {SURFACING: 0.01},
    "5 % a surfacing": {SURFACING: 0.025},
    "9 % a surfacing": {SURFACING: 0.045},
    "a fifth of the dockings misses": {"apad.dock_miss_probability": 0.2},
    "half of the dockings miss": {"apad.dock_miss_probability": 0.5},
    "unavailable for a quarter": {"apad.unavailable": [{"from_s": 600, "until_s": 1200}]},
}
"""The truth, where it differs from the scenario. The planner knows the cost of a surfacing, and nothing of the others. The
event-driven model has no wind."""
FIGURES = ("uptime_paper_mean", "uptime_paper_min", "metres")
"""Whose differences are tested."""
PLANNED = {"pool of 24": 24, "pool of 120": 120}
PLANS = 20
"""Situations that are planned for each fleet."""


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
        "dask_s": {str(count): _on_dask_s(speed_plan, count) for count in (1, 2)},
        "plan_ms": plan_times_ms(),
        "configurations": tries,
        "comparisons": [
            _compared(file, condition, tries, workers)
            for file in ("pool-12.yaml", "bay-24.yaml")
            for condition in CONDITIONS
        ],
    }


def plan_times_ms() -> dict[str, dict[str, float]]:
    """The slowest of some plans of four aMussels, by strategy and fleet, in processor time; all are in the pool."""
    model = energy_model(load(SCENARIOS / "bay-24.yaml"))
    found: dict[str, dict[str, float]] = {}
    for name in ("cautious", "blend", "rollout", "rollout-fair"):
        strategy = registry.collection(name, CostScales(**COSTS))
        for fleet, count in PLANNED.items():
            chance = Random(count)
            took = []
            for _ in range(PLANS):
                places = [(chance.uniform(0, 100), chance.uniform(0, 60)) for _ in range(count)]
                low = tuple(
                    Candidate(number, *place, chance.uniform(0, 0.8), 1.0, *place)
                    for number, place in enumerate(places, start=1)
                )
                situation = Situation(50.0, 30.0, low, (0, 1, 2, 3), (), model)
                began_s = time.process_time()
                strategy.plan(situation, 4)
                took.append(1000 * (time.process_time() - began_s))
            found.setdefault(name, {})[fleet] = max(took)
    return found


def _on_dask_s(plan: Plan, count: int) -> float:
    """The seconds for the plan's missions on a Dask scheduler with so many workers of one thread on this machine."""
    with (
        tempfile.TemporaryDirectory() as directory,
        LocalCluster(
            n_workers=count, threads_per_worker=1, dashboard_address=None, local_directory=directory
        ) as cluster,
    ):
        began_s = time.perf_counter()
        fly_study(plan, Path(directory) / "study", partial(fly_on_dask, address=cluster.scheduler_address))
        return time.perf_counter() - began_s


def _compared(file: str, condition: str, tries: int, workers: int) -> dict[str, Any]:
    study = {
        "name": "planner",
        "scenarios": [file],
        "strategies": COMPARED,
        "seeds": list(range(FIRST_HELD_OUT, FIRST_HELD_OUT + tries)),
        "parameters": {key: [value] for key, value in CONDITIONS[condition].items()},
        "primary": "uptime_paper_mean",
    }
    plan = plan_of(study, "planner", SCENARIOS)
    rows, took_s, _ = _flown(plan, workers)
    found = standings(rows, plan.strategies, "cautious", "uptime_paper_mean", 0.95)
    figures = {}
    for standing in found:
        means = {key: estimate.mean for key in COLUMNS if (estimate := standing.columns[key])}
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
        "condition": condition,
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
    took = ", ".join(f"{seconds:.1f} s with {count}" for count, seconds in result["dask_s"].items())
    console.print(f"On Dask workers: {took}")
    for name, by_fleet in result["plan_ms"].items():
        times = ", ".join(f"{ms:.1f} ms for a {fleet}" for fleet, ms in by_fleet.items())
        console.print(f"The slowest plan of {name}: {times}")
    for compared in result["comparisons"]:
        table = Table(
            title=f"{compared['scenario']}, {compared['condition']}: {result['configurations']} configurations; "
            f"nobody exceeds {compared['uptime_bound']:.1f} % uptime"
        )
        for name in (
            "",
            "lost",
            "uptime %",
            "less Cautious",
            "least %",
            "less Cautious",
            "metres",
            "of Greedy",
        ):
            table.add_column(name, justify="left" if not name else "right")
        for name, figures in compared["strategies"].items():
            means, differences = figures["means"], figures["differences"]
            table.add_row(
                name,
                f"{means['amussels_lost']:.2f}",
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
