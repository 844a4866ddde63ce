"""The least uptime that the paper's batches and full charges allow at 105 % of Greedy's way, searched in hindsight.

The order of all services of a mission is changed at random, a thousand times for each configuration, and flown each time
until its end. An order stays when its least uptime is no lower, less what its way exceeds. Such a search knows the whole
mission and its end, which no strategy does. It may miss the best order, so it is no bound, but a strategy that is to reach
more must do so without that knowledge. The configurations are those of `benchmarks/run planner`.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from functools import partial
from random import Random
from statistics import fmean
from typing import Any
from unittest.mock import patch

from rich.console import Console
from rich.table import Table

from apad_bridge.planning import registry
from apad_bridge.planning.candidates import Situation
from apad_bridge.planning.solution import Solution, StepKind
from apad_bridge.planning.strategy import collect_in_order, docks_to_fill
from apad_bridge.runs.studies.figures import Figures
from apad_bridge.runs.studies.models import Model, fly
from apad_bridge.runs.studies.statistics import estimate_of
from apad_bridge.scenario.schema import Scenario
from benchmarks.planner import CONDITIONS, FIRST_HELD_OUT, plan_for

THRESHOLDS = (0.6, 0.8)
"""The pool's; 0.8 is the paper's."""
MOST_OF_GREEDY = 1.05
FLIGHTS = 1000
PER_METRE = 0.3
"""Points of uptime that a metre above the allowed way costs, so that the search can pass through longer ways."""
NAME = "in-order"


class InOrder:
    """Collects in a given order, and in place of those who are not in the pool the ones with the least charge."""

    plans = StepKind.COLLECT

    def __init__(self, order: Sequence[int]) -> None:
        self.collected: list[int] = []
        self._order = list(order)

    def plan(self, situation: Situation, batch: int) -> Solution:
        count = docks_to_fill(situation, batch)
        in_pool = {it.agent_id: it for it in situation.candidates}
        chosen = {it: in_pool[it] for it in self._order[:count] if it in in_pool}
        del self._order[:count]
        for it in sorted(situation.candidates, key=lambda it: it.charge):
            if len(chosen) < count:
                chosen.setdefault(it.agent_id, it)
        self.collected += chosen
        return collect_in_order(chosen.values(), situation)


def flown(scenario: Scenario, order: Sequence[int]) -> tuple[Figures, list[int]]:
    """The figures of a mission that collects in this order, and the order of what it collected."""
    strategy = InOrder(order)
    # A strategy is known by its name alone, and this one must be made anew for each flight.
    with patch.dict(registry._BUILT_IN, {NAME: lambda: strategy}):
        mission = replace(scenario.mission, collection=NAME)
        return fly(replace(scenario, mission=mission), Model.EVENT_DRIVEN), strategy.collected


def search(threshold: float, flights: int, seed: int) -> dict[str, float]:
    """The best order for one configuration, as differences to Cautious and a share of Greedy's way."""
    plan = plan_for(CONDITIONS["free surfacing"], "pool-12.yaml", seed - FIRST_HELD_OUT + 1)
    names = [str(it) for it in plan.strategies]
    base = plan.scenario(0, names.index("cautious"), seed)
    cautious = fly(base, Model.EVENT_DRIVEN)
    greedy = fly(plan.scenario(0, names.index("greedy"), seed), Model.EVENT_DRIVEN)
    scenario = replace(base, mission=replace(base.mission, pool_threshold=threshold))

    def worth(figures: Figures) -> float:
        return figures.uptime_paper_min - PER_METRE * max(
            0.0, figures.metres - MOST_OF_GREEDY * greedy.metres
        )

    chance, batch, ids = Random(seed), base.mission.batch, base.fleet.ids
    best, order = flown(scenario, ())
    for _ in range(flights):
        changed = list(order)
        for _ in range(chance.choice((1, 1, 2, 3))):
            one, other = chance.randrange(len(changed)), chance.randrange(len(changed))
            if chance.random() < 0.2:
                changed[one] = chance.choice(ids)
            else:
                changed[one], changed[other] = changed[other], changed[one]
        batches = [changed[first : first + batch] for first in range(0, len(changed), batch)]
        if any(len(set(it)) < len(it) for it in batches):
            continue
        figures, collected = flown(scenario, changed)
        if worth(figures) >= worth(best):
            best, order = figures, collected
    return {
        "least_more": best.uptime_paper_min - cautious.uptime_paper_min,
        "mean_more": best.uptime_paper_mean - cautious.uptime_paper_mean,
        "of_greedys_way": best.metres / greedy.metres,
    }


def measure(tries: int = 10) -> dict[str, Any]:
    """Searches for `tries` configurations."""
    seeds = range(FIRST_HELD_OUT, FIRST_HELD_OUT + tries)
    with ProcessPoolExecutor(len(os.sched_getaffinity(0))) as workers:
        found = {it: list(workers.map(partial(search, it, FLIGHTS), seeds)) for it in THRESHOLDS}
    return {
        "configurations": tries,
        "flights": FLIGHTS,
        "thresholds": {str(it): _summed_up(rows) for it, rows in found.items()},
    }


def _summed_up(rows: list[dict[str, float]]) -> dict[str, Any]:
    least = estimate_of([row["least_more"] for row in rows], 0.95)
    assert least is not None
    return {
        "least_more": [least.mean, least.low, least.high],
        "mean_more": fmean(row["mean_more"] for row in rows),
        "of_greedys_way": fmean(row["of_greedys_way"] for row in rows),
        "reached": sum(row["least_more"] >= 3 and row["of_greedys_way"] <= MOST_OF_GREEDY for row in rows),
    }


def show(result: dict[str, Any], console: Console) -> None:
    table = Table(
        title=f"The best of {result['flights']} orders of services, {result['configurations']} configurations of the pool"
    )
    for column in (
        "pool threshold",
        "least less Cautious'",
        "mean less Cautious'",
        "of Greedy's way",
        "3 points",
    ):
        table.add_column(column, justify="right")
    for threshold, it in result["thresholds"].items():
        mean, low, high = it["least_more"]
        table.add_row(
            threshold,
            f"{mean:+.1f} +- {(high - low) / 2:.1f}",
            f"{it['mean_more']:+.1f}",
            f"{it['of_greedys_way']:.0%}",
            f"in {it['reached']}",
        )
    console.print(table)
