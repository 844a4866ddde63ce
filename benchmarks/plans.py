"""Published instances: fifty fleets and ten small ones, with bounds and plans, in benchmarks/instances, with a checker.

Each instance is drawn by its number: area, fleet, docks, start charges, motors and horizon. Its numbers are those of a
scenario, so its bounds are those that `musselbed capacity` prints for that scenario. A family of rules is flown on each, in
the checker's world: collect the nearest, the lowest, or a blend of both, one by one or in batches, from a threshold up to
a charge. Two others share nothing with them: routes with prizes by PyVRP (plan_study/route.py), and for the small instances
an exact search (plan_study/exact.py). The best of all plans is kept as the best known one. It is no optimum. For a small
instance no plan is better whose waits are whole minutes, and in which no step undoes the step before.

It writes the files anew, and keeps a plan from elsewhere that has a better score. After a better plan the row of the best
known plans in instances/results.csv is old: take it out, and add it by `instances/check.py --row`. `--row 053` takes one
instance alone.

`--row queue` flies `njnp` on the queue of its paper, and compares its latency and throughput with that of a Markov chain
(plan_study/nearest_job.py), which shares no code with it.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from importlib.util import find_spec
from itertools import product
from math import dist
from pathlib import Path
from random import Random
from typing import Any

from rich.console import Console
from rich.table import Table

from apad_bridge.assembly.capacity_bounds import battery_worth_min, bounds_of
from apad_bridge.assembly.scenario_energy_model import energy_model
from apad_bridge.planning.registry import collection
from apad_bridge.scenario.loader import from_data, load, resolve
from apad_bridge.scenario.schema import Scenario
from apad_bridge.scenario.starts import starts_of
from apad_bridge.studies.statistics import estimate_of
from benchmarks.instances.check import World, scored
from benchmarks.plan_study import route
from benchmarks.plan_study.exact import ExactSearch
from benchmarks.plan_study.nearest_job import MEAN_WAY, Law, RequestQueue, busy_rate_per_s, latency_s
from benchmarks.plan_study.request_flight import RequestFlight, Served
from benchmarks.rows import told

HERE = Path(__file__).parent
FOLDER = HERE / "instances"
POOL = HERE.parent / "launch_scripts/scenarios/pool-12.yaml"
COUNT, SMALL_COUNT = 50, 10
"""The small ones have the numbers after those of the fifty."""
SHORT = (1, COUNT + 1)
AREAS_M = {
    "line": (200.0, 1.0),
    "two clusters": (100.0, 10.0),
    "60 x 20 m": (60.0, 20.0),
    "12 x 60 m": (12.0, 60.0),
    "200 x 200 m": (200.0, 200.0),
}
FULL = 0.99
EXACT_WAIT_S = 60.0
_EXACT_AT_MOST_S = 300.0
"""Processor time for an instance."""
_PATIENCE_S = 1.0
"""A rule that waits for a charge looks again after so long."""
QUEUE = "queue"
SIDE_M, SPEED_M_S = 100.0, 0.5
CHARGE_WAYS = (0.0, 1.0, 2.0)
"""The charging time, in mean ways between two random points of the square."""
LOADS = (0.2, 0.4, 0.6, 0.8, 0.9)
"""The requests that come while a charger that takes them as they come serves one."""
BUSY_WITH = (1, 2, 4, 8, 16)
RUNS, SERVICES = 20, 20_000
_CONFIDENCE = 0.95

Instance = dict[str, Any]


@dataclass(frozen=True, slots=True)
class Rule:
    per_charge_m: float
    """The way for which a rule passes over one that has a whole battery more."""
    threshold: float
    charge_to: float
    batch: int | None
    """None: one by one, each released by itself."""

    @property
    def name(self) -> str:
        order = {0.0: "nearest", 1e6: "lowest"}.get(self.per_charge_m, f"blend, {self.per_charge_m:g} m")
        how = "one by one" if self.batch is None else f"batches of {self.batch}"
        return f"{order}, {how}, from {self.threshold:g} to {self.charge_to:g}"


def rules(docks: int) -> Iterator[Rule]:
    for order, threshold, charge_to, batch in product(
        (0.0, 50.0, 200.0, 1e6), (0.5, 0.7, 0.8, 0.95), (0.7, 0.8, 0.9, FULL), (None, docks)
    ):
        if threshold < charge_to:
            yield Rule(order, threshold, charge_to, batch)


def scenario_of(number: int) -> tuple[str, Scenario]:
    """The area and the scenario from which the instance with this number is made. It has no two clusters yet."""
    is_small, random = number > COUNT, Random(f"instance {number}")
    area = random.choice(list(AREAS_M))
    north_m, east_m = AREAS_M[area]
    data = resolve(load(POOL))
    data["seed"] = number
    data["duration_s"] = float(random.choice((480, 600) if is_small else (2400, 4800, 9600)))
    data["area"] |= {
        "polygon_m": [[0.0, 0.0], [north_m, 0.0], [north_m, east_m], [0.0, east_m]],
        "chart": None,
    }
    data["apad"] |= {
        "start_m": [north_m / 2, east_m / 2],
        "profile": None,
        "docks": random.choice((1, 2) if is_small else (2, 4)),
    }
    data["mission"]["batch"] = data["apad"]["docks"]
    data["board"] |= {"motor_run_charge": random.choice((0.0, 0.0225)), "profile": None}
    # A small instance is over within hours, so its charges matter only if they are low.
    low, high = random.choice(((0.05, 0.2), (0.1, 0.4)) if is_small else ((0.6, 1.0), (0.3, 0.9), (0.2, 0.5)))
    data["fleet"] |= {
        "agent_ids": [],
        "count": random.choice((4, 5, 6) if is_small else (8, 12, 20)),
        "start": {"charge": [low, high]},
    }
    return area, from_data(data, f"instance {number}")


def instance_of(number: int) -> Instance:
    """The instance with this number, from 1 on."""
    area, scenario = scenario_of(number)
    north_m = AREAS_M[area][0]
    places_m = [
        (_clustered(it.north_m, north_m) if area == "two clusters" else it.north_m, it.east_m)
        for it in starts_of(scenario)
    ]
    bounds, model = bounds_of([scenario]), energy_model(scenario)
    return {
        "name": f"{number:03}",
        "area": area,
        "horizon_s": scenario.duration_s,
        "docks": scenario.apad.docks,
        "start_m": list(scenario.apad.start_m),
        "speed_m_s": model.speed_m_s,
        "dock_s": model.dock_s,
        "undock_s": model.undock_s,
        "drain_per_s": model.drain_per_s,
        "curve": [list(it) for it in model.curve],
        "motor_run": model.motor_run,
        "places_m": [[round(it, 3) for it in place_m] for place_m in places_m],
        "charges": [it.primary for it in starts_of(scenario)],
        "battery_worth_s": 60 * battery_worth_min(scenario) / scenario.theta,
        "bound_percent": bounds.uptime_for_ever_percent,
        "uptime_bound_percent": bounds.uptime_percent,
    }


def _clustered(north_m: float, span_m: float) -> float:
    """Moves a place into the first or the last tenth of the area."""
    share = north_m / span_m
    return span_m * (share / 5 if share < 0.5 else 1 - (1 - share) / 5)


def flown(instance: Instance, rule: Rule) -> World:
    """The world at the end of a rule's mission."""
    world = World(instance)
    while world.fly(_next(world, rule)):
        pass
    return world


def _next(world: World, rule: Rule) -> list[Any]:
    docks, docked = world.instance["docks"], sorted(world.docked)
    pool = [
        it
        for it in range(len(world.instance["places_m"]))
        if it not in world.docked and world.charge(it) <= rule.threshold
    ]
    done = [it for it in docked if world.charge(it) >= (rule.charge_to if pool else FULL)]
    if rule.batch is None:
        if done:
            return ["deploy", _nearest(world, done)]
        if pool and len(docked) < docks:
            return ["collect", _chosen(world, pool, rule)]
        return ["wait", _PATIENCE_S]
    kind = world.steps[-1][0] if world.steps else "deploy"
    if docked and (kind == "deploy" or len(done) == len(docked)):
        return ["deploy", _nearest(world, docked)]  # a batch leaves as a whole
    if pool and len(docked) < rule.batch and (kind == "collect" or (not docked and len(pool) >= rule.batch)):
        return ["collect", _chosen(world, pool, rule)]
    return ["wait", _PATIENCE_S]


def _nearest(world: World, agents: list[int]) -> int:
    return min(agents, key=lambda it: (dist(world.place_m, world.goal_m(it)), it))


def _chosen(world: World, pool: list[int], rule: Rule) -> int:
    def cost(agent: int) -> tuple[float, int]:
        return dist(world.place_m, world.goal_m(agent)) + rule.per_charge_m * world.charge(agent), agent

    return min(pool, key=cost)


def _merged(steps: Sequence[Sequence[Any]]) -> list[list[Any]]:
    """The same steps, with waits in a row as one."""
    merged: list[list[Any]] = []
    for kind, value in steps:
        if kind == "wait" and merged and merged[-1][0] == "wait":
            merged[-1] = ["wait", merged[-1][1] + value]
        else:
            merged.append([kind, value])
    return merged


def measure(short: bool = False, row: Sequence[str] | None = None) -> dict[str, Any]:
    """Writes the instances and their best known plans; a row for each. Without PyVRP no route is planned.

    Beside them is what `njnp` takes on the queue of its paper. `row` chooses instances by name, or "queue".
    """
    numbers: Sequence[int] = SHORT if short else range(1, COUNT + SMALL_COUNT + 1)
    if row is not None:
        numbers = [int(name) for name in row if name != QUEUE]
    result: dict[str, Any] = {"rows": [_row(number) for number in numbers]}
    if row is None or QUEUE in row:
        result[QUEUE] = queue_rows(RUNS // 5, SERVICES // 5, LOADS[1::2]) if short else queue_rows()
    return result


def queue_rows(
    runs: int = RUNS, services: int = SERVICES, loads: Sequence[float] = LOADS
) -> list[dict[str, Any]]:
    """Latency in minutes at each load, and throughput in an hour where so many requests always wait."""
    way_s = MEAN_WAY * SIDE_M / SPEED_M_S
    rows = []
    for charge_ways in CHARGE_WAYS:
        queue = RequestQueue(SIDE_M, SPEED_M_S, charge_ways * way_s, 1.0)
        for each_load in loads:
            loaded = replace(queue, rate_per_s=each_load / (way_s + queue.charge_s))
            flown, turned = _served(loaded, runs, services), _served(loaded, runs, services, turns=True)
            redrawn = _served(loaded, runs, services, redrawn=True)
            about = {"figure": "latency, min", "charge_ways": charge_ways, "at": each_load}
            rows.append(
                _against(about, latency_s(loaded) / 60, [it.latency_s / 60 for it in flown])
                | _against(
                    {},
                    latency_s(loaded, Law.BY_PLACE) / 60,
                    [it.latency_s / 60 for it in redrawn],
                    "redrawn_",
                )
                | _against(
                    {}, latency_s(loaded, turns=True) / 60, [it.latency_s / 60 for it in turned], "turns_"
                )
                | _against({}, 3600 * loaded.rate_per_s, [3600 * it.rate_per_s for it in flown], "rate_")
            )
        for busy_with in BUSY_WITH:
            flown = _served(queue, runs, services, busy_with=busy_with)
            redrawn = _served(queue, runs, services, busy_with=busy_with, redrawn=True)
            about = {"figure": "charged in an hour", "charge_ways": charge_ways, "at": busy_with}
            by_place = busy_rate_per_s(queue, busy_with, Law.BY_PLACE)
            rows.append(
                _against(
                    about, 3600 * busy_rate_per_s(queue, busy_with), [3600 * it.rate_per_s for it in flown]
                )
                | _against({}, 3600 * by_place, [3600 * it.rate_per_s for it in redrawn], "redrawn_")
            )
    return [told(row) for row in rows]


def _served(queue: RequestQueue, runs: int, services: int, **how: Any) -> list[Served]:
    strategy = collection("njnp")
    return [RequestFlight(strategy, queue, seed, **how).served(services) for seed in range(runs)]


def _against(
    about: dict[str, Any], analysis: float, flown: Sequence[float], prefix: str = ""
) -> dict[str, Any]:
    """The analysis, the mean of the flights, half of its interval, and how far the flights lie above the analysis."""
    estimate = estimate_of(flown, _CONFIDENCE)
    assert estimate is not None
    figures = {
        "analysis": analysis,
        "flown": estimate.mean,
        "half": estimate.high - estimate.mean,
        "above_percent": 100 * (estimate.mean / analysis - 1),
    }
    return about | {prefix + key: value for key, value in figures.items()}


def _row(number: int) -> dict[str, Any]:
    instance = instance_of(number)
    name = instance["name"]
    plans = {
        "rules": _best(instance, ((rule.name, flown(instance, rule)) for rule in rules(instance["docks"])))
    }
    if find_spec("pyvrp") is not None:
        plans["route"] = _best(instance, ((it.name, route.flown(instance, it)) for it in route.all_rounds()))
    kept, is_proven = FOLDER / f"{name}-best.json", None
    if kept.exists():
        plans["kept"] = json.loads(kept.read_text())
    scores = {by: scored(instance, plan)["score"] for by, plan in plans.items()}
    if number > COUNT:
        search = ExactSearch(instance, EXACT_WAIT_S, max(scores.values()))
        is_proven = search.search(_EXACT_AT_MOST_S)
        if search.plan is not None:
            plans["exact"] = _plan(instance, f"branch and bound, waits of {EXACT_WAIT_S:g} s", search.plan)
            scores["exact"] = scored(instance, plans["exact"])["score"]
    best = plans[max(scores, key=lambda by: scores[by])]
    if is_proven:
        # The search found none that is better, so the best known score is the exact one.
        scores["exact"] = max(scores.values())
    kept.write_text(json.dumps(best) + "\n")
    (FOLDER / f"{name}.json").write_text(json.dumps(instance) + "\n")
    about = {key: instance[key] for key in ("name", "area", "docks", "motor_run", "horizon_s")}
    return told(
        {
            **about,
            "amussels": len(instance["charges"]),
            "bound": instance["bound_percent"],
            **scored(instance, best),
            "by": best["by"],
            **{by: scores.get(by) for by in ("rules", "route", "exact")},
            "is_proven": is_proven,
        }
    )


def _best(instance: Instance, ends: Iterator[tuple[str, World]]) -> dict[str, Any]:
    """The plan with the greatest score, of missions with their names."""
    plans = (_plan(instance, name, world.steps) for name, world in ends)
    return max(plans, key=lambda plan: float(scored(instance, plan)["score"]))


def _plan(instance: Instance, by: str, steps: Sequence[Sequence[Any]]) -> dict[str, Any]:
    return {"instance": instance["name"], "by": by, "steps": _merged(steps)}


def show(result: dict[str, Any], console: Console) -> None:
    table = Table(title="Best known plans of the published instances")
    headings = (
        "instance",
        "area",
        "aMussels",
        "docks",
        "score",
        "bound",
        "rules",
        "route",
        "exact",
        "metres",
        "by",
    )
    for heading in headings:
        table.add_column(heading)
    for it in result["rows"]:
        table.add_row(
            it["name"],
            it["area"],
            str(it["amussels"]),
            str(it["docks"]),
            f"{it['score']:.2f}",
            f"{it['bound']:.2f}",
            *("" if it[by] is None else f"{it[by]:.2f}" for by in ("rules", "route", "exact")),
            f"{it['metres']:.0f}",
            it["by"],
        )
    console.print(table)
    if QUEUE in result:
        console.print(_queue_table(result[QUEUE]))


def _queue_table(rows: Sequence[dict[str, Any]]) -> Table:
    table = Table(
        title="njnp on the queue of its paper: analysis; flown, and what it lies above the analysis"
    )
    kinds = {"": "", "redrawn_": "places drawn anew", "turns_": "turns round", "rate_": "charged in an hour"}
    for heading in ("figure", "charging, mean ways", "load, or waiting", *kinds.values()):
        table.add_column(heading)
    for row in rows:
        cells = (
            f"{row[kind + 'analysis']:.3f}; {row[kind + 'flown']:.3f} +- {row[kind + 'half']:.3f}, "
            f"{row[kind + 'above_percent']:+.1f} %"
            if kind + "flown" in row
            else ""
            for kind in kinds
        )
        table.add_row(row["figure"], f"{row['charge_ways']:g}", f"{row['at']:g}", *cells)
    return table
