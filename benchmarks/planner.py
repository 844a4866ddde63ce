"""The time of a plan by strategy and fleet, and the missions that a study flies in a second.

The start of a study's processes counts. On a busy machine the missions a second of processor time say more.
"""

from __future__ import annotations

import os
import resource
import tempfile
import time
from dataclasses import replace
from functools import partial
from pathlib import Path
from random import Random
from typing import Any

from distributed import LocalCluster
from rich.console import Console

from apad_bridge.assembly.scenario_energy_model import energy_model
from apad_bridge.planning import registry
from apad_bridge.planning.candidates import Candidate, Situation
from apad_bridge.planning.costs import CostScales
from apad_bridge.planning.dispatch_rule import Dispatch, Places
from apad_bridge.scenario.loader import load
from apad_bridge.studies.dask_cluster import fly_on_dask
from apad_bridge.studies.runner import Row, fly_study
from apad_bridge.studies.specification import StudyPlan, plan_of
from benchmarks.rows import told

SCENARIOS = Path(__file__).parents[1] / "launch_scripts/scenarios"
MISSIONS, SHORT_MISSIONS = 1200, 30
STRATEGIES = ["greedy", "cautious", "blend"]
"""All with Greedy Redeploy and the paper's batches; the blend weighs a battery as 1 m."""
COSTS = {"distance_per_m": 1.0, "energy_per_charge": 100.0}
"""A battery is worth 100 m."""
LEAD: dict[str, Any] = {"pool_threshold": 0.95, "charge_lead": 0.45, "again_threshold": 0.02}
PLANNED = {"pool of 24": 24, "pool of 120": 120}
PLANNERS: dict[str, dict[str, Any]] = {
    **{name: {} for name in ("cautious", "blend", "rollout", "rollout-fair")},
    "rollout-fair, lead": LEAD,
    "rollout-fair, lead, exchanged": {**LEAD, "places": Places.EXCHANGED},
    "rollout-fair, one by one, lead, exchanged": {
        **LEAD,
        "places": Places.EXCHANGED,
        "dispatch": Dispatch.ASYNCHRONOUS,
    },
}
"""Strategies whose plans are timed, and the rules that their energy model follows."""
PLANS, SHORT_PLANS = 20, 2
"""Situations that are planned for each fleet."""


def measure(short: bool = False) -> dict[str, Any]:
    workers = len(os.sched_getaffinity(0))
    missions, plans = (SHORT_MISSIONS, SHORT_PLANS) if short else (MISSIONS, PLANS)
    plan = plan_of(
        {
            "name": "planner",
            "scenarios": ["pool-12.yaml"],
            "strategies": STRATEGIES,
            "seeds": missions // len(STRATEGIES),
        },
        "planner",
        SCENARIOS,
    )
    load_before = os.getloadavg()[0]
    rows, took_s, cpu_s = _flown(plan, workers)
    speed = told(
        {
            "missions": len(rows),
            "took_s": took_s,
            "missions_per_s": len(rows) / took_s,
            "missions_per_cpu_s": len(rows) / cpu_s,
        }
    )
    return {
        **speed,
        "processes": workers,
        "load_before": load_before,
        "dask_s": told({str(count): _on_dask_s(plan, count) for count in (1, 2)}),
        "plan_ms": told(plan_times_ms(plans)),
    }


def plan_times_ms(plans: int) -> dict[str, dict[str, float]]:
    """The slowest of some plans of four aMussels, by strategy and fleet, in processor time; all are in the pool."""
    nominal = energy_model(load(SCENARIOS / "bay-24.yaml"))
    found: dict[str, dict[str, float]] = {}
    for name, rules in PLANNERS.items():
        strategy = registry.collection(name.partition(",")[0], CostScales(**COSTS))
        model = replace(nominal, **rules)
        for fleet, count in PLANNED.items():
            chance = Random(count)
            took = []
            for _ in range(plans):
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


def _on_dask_s(plan: StudyPlan, count: int) -> float:
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


def _flown(plan: StudyPlan, workers: int) -> tuple[list[Row], float, float]:
    """The rows, and the seconds by the clock and of processors."""
    before_s = _processor_s()
    with tempfile.TemporaryDirectory() as directory:
        began_s = time.perf_counter()
        rows = fly_study(plan, Path(directory) / "study", workers)
        took_s = time.perf_counter() - began_s
    return rows, took_s, _processor_s() - before_s


def _processor_s() -> float:
    """The processor time of this process and its children: where there is one processor, a study flies in this process."""
    used = [resource.getrusage(it) for it in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(it.ru_utime + it.ru_stime for it in used)


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
