"""Strategies and rules of dispatch against the paper's, on held-out configurations; and how fast a study flies.

The rules of the comparison:

- Every parameter below was chosen on seeds below 30001, and is the same for each fleet and area.
- Each held-out seed draws the shape of its area, of equal size, and the interval of its starting charges.
- No strategy knows when the mission ends, but for the rule `known end`.
- The planner's rates are the scenario's. Under a condition the truth differs from them. Plans are made from beliefs.
- Each rule of dispatch flies with Greedy and with Cautious too, so a gain splits into the rule's and the strategy's part.
- Differences are paired, with 95 % intervals of Student's t; the p-values are adjusted by Holm, over all differences of
  a table.

The goals are differences to Cautious with the paper's batches; metres are compared with Greedy's, with those batches. A run
that is ended goes on from `studies/planner-*` below the present directory with the same command.
"""

from __future__ import annotations

import os
import resource
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from math import sqrt
from pathlib import Path
from random import Random
from statistics import fmean
from typing import Any

from distributed import LocalCluster
from rich.console import Console
from rich.table import Table
from shapely import Polygon

from apad_bridge.assembly.capacity import bounds_of, uptime_with_services
from apad_bridge.assembly.energy_model import energy_model
from apad_bridge.planning import registry
from apad_bridge.planning.candidates import Candidate, Situation
from apad_bridge.planning.costs import CostScales
from apad_bridge.scenario.loader import load
from apad_bridge.scenario.schema import Scenario
from apad_bridge.studies.dask_cluster import fly_on_dask
from apad_bridge.studies.figures import COLUMNS
from apad_bridge.studies.models import Model, fly_each_tick
from apad_bridge.studies.report import HEADINGS
from apad_bridge.studies.runner import Block, Fly, Row, fly_study
from apad_bridge.studies.specification import StudyPlan, plan_of
from apad_bridge.studies.statistics import holm, standings
from benchmarks.beliefs_flown import hear_few, with_twins
from benchmarks.rows import told

SCENARIOS = Path(__file__).parents[1] / "launch_scripts/scenarios"
MISSIONS, SHORT_MISSIONS = 1200, 30
STRATEGIES = ["greedy", "cautious", "blend"]
"""All with Greedy Redeploy and the paper's batches; the blend weighs a battery as 1 m."""
FIRST_HELD_OUT = 30_001
COSTS = {"distance_per_m": 1.0, "energy_per_charge": 100.0}
"""A battery is worth 100 m."""
FIFTY_M = {"costs": {"distance_per_m": 1.0, "energy_per_charge": 50.0}}
"""A battery is worth 50 m."""
COLLECTIONS: dict[str, dict[str, Any]] = {
    "cautious": {"collection": "cautious"},
    "greedy": {"collection": "greedy"},
    "blend": {"collection": "blend", **FIFTY_M},
    "rollout-fair": {"collection": "rollout-fair", "costs": COSTS},
}
LEAD: dict[str, Any] = {"pool_threshold": 0.95, "charge_lead": 0.45, "again_threshold": 0.02}
EXCHANGED: dict[str, Any] = {"places": "exchanged"}
RULES: dict[str, dict[str, Any]] = {
    "": {},
    "again": {"again_threshold": 0.02},
    "one by one again": {"dispatch": "asynchronous", "again_threshold": 0.02},
    "lead": LEAD,
    "three, lead": {"batch": 3, **LEAD},
    "one by one, lead": {"dispatch": "asynchronous", **LEAD},
    "exchanged": EXCHANGED,
    "three, lead, exchanged": {"batch": 3, **LEAD, "charge_lead": 0.35, **EXCHANGED},
    "one by one, lead, exchanged": {"dispatch": "asynchronous", **LEAD, **EXCHANGED},
}
"""The first is the paper's. "again" keeps its batches of four and its full charges, "exchanged" all but the places."""
COMPARED = [
    {"name": ", ".join(filter(None, (name, rule))), **collection, **keys}
    for rule, keys in RULES.items()
    for name, collection in COLLECTIONS.items()
]
KNOWN_ENDS = {
    "known end": {"batch": 3, "pool_threshold": 0.95, "horizon": "end"},
    "known end, one by one": {
        "dispatch": "asynchronous",
        "pool_threshold": 0.95,
        "again_threshold": 0.02,
        "horizon": "end",
    },
}
COMPARED += [
    {"name": f"{collection}, {rule}", "collection": collection, **FIFTY_M, **keys}
    for rule, keys in KNOWN_ENDS.items()
    for collection in ("blend", "rollout-fair", "cautious", "greedy")
]
"""Missions that know their end are flown beside the others, and no goal counts them."""
FEW = (
    "cautious",
    "greedy",
    "rollout-fair",
    "rollout-fair, again",
    "rollout-fair, one by one again",
    "rollout-fair, lead",
    "rollout-fair, three, lead",
    "rollout-fair, one by one, lead",
    "rollout-fair, three, lead, exchanged",
    "blend, one by one, lead, exchanged",
)
SURFACING = "board.motor_run_charge"
SPREAD = {"fleet.spread.drain": 0.05, "fleet.spread.capacity": 0.05}
HALF_SIDES = ((1.0, 1.0), (1.73, 0.577), (0.577, 1.73))
"""Rectangles by their half sides, north and east, in the half side of the square of the same size."""
CHARGES = ([0.6, 1.0], [0.4, 1.0], [0.7, 0.9], [0.5, 0.8])


@dataclass(frozen=True)
class Condition:
    """The truth where it differs from the scenario. The planner knows the cost of a surfacing, and nothing else."""

    truth: dict[str, Any] = field(default_factory=dict)
    compared: Sequence[str] = FEW
    share: float = 0.25
    """The part of the configurations that is flown."""
    is_drawn: bool = True
    """False: every seed has the scenario's area, and charges from the paper's interval."""
    model: Model = Model.EVENT_DRIVEN
    flies: Fly | None = None
    """Flies the missions in place of the workers of the study."""


def _on_twins(plan: StudyPlan, blocks: Sequence[Block]) -> Iterator[tuple[Block, list[Row]]]:
    """Flies missions on twins that receive one hourly packet in ten."""
    for setting, seed in blocks:
        rows = []
        for index, strategy in enumerate(plan.strategies):
            scenario = with_twins(plan.scenario(setting, index, seed))
            figures = fly_each_tick(scenario, partial(hear_few, seed=seed))
            rows.append({"setting": setting, "strategy": strategy, "seed": seed, **asdict(figures)})
        yield (setting, seed), rows


ALL = tuple(str(it["name"]) for it in COMPARED)
CONDITIONS = {
    "free surfacing": Condition(compared=ALL, share=1),
    "5 % a surfacing": Condition({SURFACING: 0.025}, ALL, 1),
    "the paper's area and charges": Condition(share=0.5, is_drawn=False),
    "2 % a surfacing": Condition({SURFACING: 0.01}),
    "9 % a surfacing": Condition({SURFACING: 0.045}),
    "10 % more drain": Condition({"fleet.spread.drain_bias": 0.1, **SPREAD}),
    "20 % more drain": Condition({"fleet.spread.drain_bias": 0.2, **SPREAD}),
    "a fifth of the dockings misses": Condition({"apad.dock_miss_probability": 0.2}),
    "half of the dockings miss": Condition({"apad.dock_miss_probability": 0.5}),
    "unavailable for a quarter": Condition({"apad.unavailable": [{"from_s": 600, "until_s": 1200}]}),
    "wind of 5 m/s, leeway 3 %": Condition(
        {"water": {"wind": {"north_m_s": 4.0, "east_m_s": 3.0}}}, FEW, 0.05, model=Model.MISSION
    ),
    "one packet in ten": Condition(share=0.1, model=Model.MISSION, flies=_on_twins),
}
"""The event-driven model has neither wind nor twins, so the last two are flown tick by tick."""
SHORT_CONDITION, SHORT_TRIES = "the paper's area and charges", 4
FIGURES = ("uptime_paper_mean", "uptime_paper_min", "metres")
"""The columns whose differences are tested."""
PLANNED = {"pool of 24": 24, "pool of 120": 120}
PLANNERS: dict[str, dict[str, Any]] = {
    **{name: {} for name in ("cautious", "blend", "rollout", "rollout-fair")},
    "rollout-fair, lead": LEAD,
    "rollout-fair, lead, exchanged": {**LEAD, "exchanges_places": True},
    "rollout-fair, one by one, lead, exchanged": {**LEAD, "exchanges_places": True, "is_asynchronous": True},
}
"""Strategies whose plans are timed, and the rules that their energy model follows."""
PLANS, SHORT_PLANS = 20, 2
"""Situations that are planned for each fleet."""


def measure(tries: int = 200, short: bool = False) -> dict[str, Any]:
    """The start of the processes counts. On a busy machine the missions a second of processor time say more."""
    workers = len(os.sched_getaffinity(0))
    missions, plans, conditions = MISSIONS, PLANS, tuple(CONDITIONS)
    if short:
        tries, missions, plans, conditions = SHORT_TRIES, SHORT_MISSIONS, SHORT_PLANS, (SHORT_CONDITION,)
    speed_plan = plan_of(
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
    rows, took_s, cpu_s = _flown(speed_plan, workers)
    speed = told(
        {
            "missions": len(rows),
            "took_s": took_s,
            "missions_per_s": len(rows) / took_s,
            "missions_per_cpu_s": len(rows) / cpu_s,
        }
    )
    dask_s = told({str(count): _on_dask_s(speed_plan, count) for count in (1, 2)})
    plan_ms = told(plan_times_ms(plans))
    with tempfile.TemporaryDirectory() as passing:
        studies = Path(passing) if short else Path("studies")
        comparisons = [
            told(_compared(name, file, tries, workers, studies))
            for name in conditions
            for file in ("pool-12.yaml", "bay-24.yaml")
        ]
    return {
        **speed,
        "processes": workers,
        "load_before": load_before,
        "dask_s": dask_s,
        "plan_ms": plan_ms,
        "configurations": tries,
        "comparisons": comparisons,
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


def _compared(name: str, file: str, tries: int, workers: int, studies: Path) -> dict[str, Any]:
    condition = CONDITIONS[name]
    plan = plan_for(condition, file, max(1, round(condition.share * tries)))
    directory = studies / f"planner-{Path(file).stem}-{list(CONDITIONS).index(name):02}"
    return {
        "condition": name,
        "scenario": file,
        **compared(plan, fly_study(plan, directory, condition.flies or workers)),
    }


def plan_for(condition: Condition, file: str, configurations: int) -> StudyPlan:
    """The study of a condition on the first held-out configurations of a scenario."""
    study = {
        "name": "planner",
        "scenarios": [file],
        "strategies": [it for it in COMPARED if it["name"] in condition.compared],
        "seeds": list(range(FIRST_HELD_OUT, FIRST_HELD_OUT + configurations)),
        "parameters": {key: [value] for key, value in condition.truth.items()},
        "draws": _draws(load(SCENARIOS / file)) if condition.is_drawn else {},
        "primary": "uptime_paper_mean",
        "model": condition.model.value,
    }
    return plan_of(study, "planner", SCENARIOS)


def _draws(scenario: Scenario) -> dict[str, list[Any]]:
    """Areas of the scenario's size around the aPad's start, its own among them, and intervals of charges."""
    area, (north_m, east_m) = scenario.area.polygon_m, scenario.apad.start_m
    half_m = sqrt(Polygon(area).area) / 2
    corners = ((-1, -1), (1, -1), (1, 1), (-1, 1))
    rectangles = [
        [[north_m + half_m * high * up, east_m + half_m * wide * right] for up, right in corners]
        for high, wide in HALF_SIDES
    ]
    return {"area.polygon_m": [[list(it) for it in area], *rectangles], "fleet.start.charge": list(CHARGES)}


def compared(plan: StudyPlan, rows: list[Row]) -> dict[str, Any]:
    """The figures of one table: means, differences to Cautious with Holm's p, and the way as a share of Greedy's."""
    found = standings(rows, plan.strategies, "cautious", "uptime_paper_mean", 0.95)
    figures: dict[str, Any] = {}
    for standing in found:
        figures[standing.strategy] = {
            "means": {key: None if it is None else it.mean for key, it in standing.columns.items()},
            "differences": {
                key: [it.estimate.mean, it.estimate.low, it.estimate.high]
                for key in FIGURES
                if (it := standing.differences.get(key))
            },
        }
    # The study adjusts each pair by itself; these are adjusted over all pairs and figures of the table.
    pairs = [(name, key) for name, its in figures.items() for key in its["differences"]]
    adjusted = holm([_p_of(rows, *pair) for pair in pairs])
    for (name, key), p in zip(pairs, adjusted, strict=True):
        figures[name].setdefault("p", {})[key] = p
    greedy_m = figures["greedy"]["means"]["metres"]
    for standing in standings(rows, plan.strategies, "greedy", "metres", 0.95):
        its = figures[standing.strategy]
        its["metres_of_greedy"] = its["means"]["metres"] / greedy_m
        if more := standing.differences.get("metres"):
            its["metres_more_than_greedy"] = [more.estimate.mean, more.estimate.low, more.estimate.high]
    scenarios = [plan.scenario(0, 0, seed) for seed in plan.seeds]
    services = greedy_m / fmean(_metres_on_tour(it) for it in scenarios)
    return {
        "configurations": len(plan.seeds),
        "uptime_bound": bounds_of(scenarios).uptime_percent,
        "services_of_greedys_way": services,
        "uptime_bound_of_greedys_way": fmean(uptime_with_services(it, services) for it in scenarios),
        "strategies": figures,
    }


def _metres_on_tour(scenario: Scenario) -> float:
    """The metres for each aMussel of the shortest closed tour through all, where they are many and lie anywhere.

    Source: J. Beardwood, J. H. Halton, J. M. Hammersley, "The shortest path through many points", 1959, with the constant
    0.7124 that is known from computation.
    """
    return 0.7124 * sqrt(Polygon(scenario.area.polygon_m).area / len(scenario.fleet.ids))


def _p_of(rows: list[Row], strategy: str, column: str) -> float:
    from scipy.stats import ttest_rel

    ours, theirs = (
        [row[column] for row in sorted(rows, key=lambda it: it["seed"]) if row["strategy"] == name]
        for name in (strategy, "cautious")
    )
    return float(ttest_rel(ours, theirs).pvalue)


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
    for each in result["comparisons"]:
        table = Table(
            title=f"{each['scenario']}, {each['condition']}: {each['configurations']} configurations; "
            f"nobody exceeds {each['uptime_bound']:.1f} % uptime, or {each['uptime_bound_of_greedys_way']:.1f} % with "
            f"{each['services_of_greedys_way']:.0f} services, for which Greedy's way lasts on a tour"
        )
        for name in (
            "",
            *(HEADINGS[key] for key in COLUMNS),
            "uptime less Cautious",
            "least less Cautious",
            "of Greedy",
        ):
            table.add_column(name, justify="right" if name else "left")
        for name, figures in each["strategies"].items():
            table.add_row(
                name,
                *("–" if mean is None else f"{mean:.4g}" for mean in figures["means"].values()),
                *(_difference(figures, key) for key in ("uptime_paper_mean", "uptime_paper_min")),
                f"{figures['metres_of_greedy']:.0%}",
            )
        console.print(table)


def _difference(figures: dict[str, Any], key: str) -> str:
    if key not in figures["differences"]:
        return ""
    mean, low, high = figures["differences"][key]
    return f"{mean:+.2f} +- {(high - low) / 2:.2f}" + ("" if figures["p"][key] < 0.05 else " (n.s.)")
