"""A study of 1200 forty-minute missions of the pool: missions a second, on all processors."""

from __future__ import annotations

import os
import resource
import tempfile
import time
from pathlib import Path
from typing import Any

from rich.console import Console

from apad_bridge.runs.studies.runner import fly_study
from apad_bridge.runs.studies.specification import plan_of

SCENARIOS = Path(__file__).parents[1] / "launch_scripts/scenarios"
MISSIONS = 1200
STRATEGIES = ["greedy", "cautious", "blend"]
"""All with Greedy Redeploy and the paper's batches; the blend weighs a battery as 1 m."""


def measure() -> dict[str, Any]:
    """The start of the processes counts. On a busy machine the missions a second of processor time say more."""
    workers = len(os.sched_getaffinity(0))
    study = {
        "name": "planner",
        "scenarios": ["pool-12.yaml"],
        "strategies": STRATEGIES,
        "seeds": MISSIONS // len(STRATEGIES),
    }
    plan = plan_of(study, "planner", SCENARIOS)
    with tempfile.TemporaryDirectory() as directory:
        began_s = time.perf_counter()
        rows = fly_study(plan, Path(directory) / "study", workers)
        took_s = time.perf_counter() - began_s
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return {
        "missions": len(rows),
        "took_s": took_s,
        "missions_per_s": len(rows) / took_s,
        "missions_per_cpu_s": len(rows) / (used.ru_utime + used.ru_stime),
        "processes": workers,
        "load_before": os.getloadavg()[0],
    }


def show(result: dict[str, Any], console: Console) -> None:
    console.print(
        f"{result['missions']} missions in {result['took_s']:.1f} s: {result['missions_per_s']:.1f} a second with "
        f"{result['processes']} processes, {result['missions_per_cpu_s']:.1f} a second of processor time"
    )
