"""Ten days of the aMussels' time: aMussels lost, samples and metres with free and with costly surfacing, beside the law.

- The declared comparisons fly all `tries` configurations, theta 30 and 1; the other settings a few, to show a trend.
- Capacity: the fleets about the law at theta 1. An aMussel that was ever empty was not sustained, so the measured capacity
  is the largest fleet without a dead hour. For whole boards that sleep it is taken from the balance of a fleet's charge.
- Five aPads: 120 aMussels in clumps that draw 90 % of the law; each aPad's share is a mission of its own.
- The aPad's energy is unlimited, but for one setting in which its 230 Wh are charged at home.

At theta 1 the random drift is left out: 15 s of a processor for each configuration, and it moves an aMussel by less than a
metre between its services. A run that is ended goes on from `studies/ten-days-*` below the present directory.
"""

from __future__ import annotations

import os
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from math import cos, pi, sin
from pathlib import Path
from random import Random
from statistics import fmean
from typing import Any

from rich.console import Console
from rich.table import Table

from apad_bridge.assembly.capacity import bounds_of, drain_at_load, rates_of, sustained_by_balance
from apad_bridge.scenario.loader import from_data, load, resolve
from apad_bridge.scenario.schema import Scenario
from apad_bridge.scenario.starts import Start, save_starts, starts_of
from apad_bridge.studies.event_driven import fly_shares
from apad_bridge.studies.figures import COLUMNS
from apad_bridge.studies.models import fly_each_tick
from apad_bridge.studies.report import HEADINGS, as_data, comparisons
from apad_bridge.studies.runner import fly_study
from apad_bridge.studies.specification import StudyPlan, plan_of
from benchmarks.rows import told

SCENARIOS = Path(__file__).parents[1] / "launch_scripts/scenarios"
TEN_DAYS_S = 10 * 86_400
UNLIMITED_WH = 1e6
BATCH: dict[str, Any] = {"name": "cautious, batch", "collection": "cautious"}
PARTIAL: dict[str, Any] = {
    "name": "cautious, partial",
    "collection": "cautious",
    "dispatch": "asynchronous",
    "pool_threshold": 0.7,
    "charge_to": 0.95,
}
TO_FULL: dict[str, Any] = {
    "name": "cautious, to full",
    "collection": "cautious",
    "dispatch": "asynchronous",
    "pool_threshold": 0.7,
}
EXCHANGED: dict[str, Any] = {
    "name": "blend, partial, exchanged",
    "collection": "blend",
    "costs": {"distance_per_m": 1.0, "energy_per_charge": 50.0},
    "dispatch": "asynchronous",
    "places": "exchanged",
    "pool_threshold": 0.5,
    "charge_to": 0.9,
}
EXCHANGED_TO_FULL = {
    **{key: value for key, value in EXCHANGED.items() if key != "charge_to"},
    "name": "blend, to full, exchanged",
    "pool_threshold": 0.6,
}
"""The parameters were chosen on the seeds 301 to 303, those with exchanged places on 301 and 302."""
FIRST_HELD_OUT = 20_001
FEW = 20
HOME = {"charging_w": 300.0, "go_at": 0.2}
LOAD = 0.9
"""The part of the law that five aPads' 120 aMussels draw."""
CLUMPS, CLUMP_M = 8, 5.0
PROCESSING_S = (60, 120, 240, 600)
"""An hour's processing of the boards that sleep."""
DAYS = (2, 4)
DOCKS = 3
TIMESLOTS = 60
"""Timeslots of 5 s in a frame of 300 s: no larger fleet has one for each aMussel."""
MIDWAY_S = 1800
FAST_PART = (0.5634, 0.985)
"""From the knee of the charging curve to the charge at which the mission releases boards that sleep."""


@dataclass(frozen=True, slots=True)
class Setting:
    """Missions of ten days with the same theta and the same cost of a surfacing and a sinking, as a part of a battery."""

    name: str
    theta: int
    counts: list[int]
    surfacing: float
    strategies: list[dict[str, Any]] = field(default_factory=lambda: [BATCH, PARTIAL, EXCHANGED])
    is_declared: bool = False
    """A comparison that was declared before it was flown: with every configuration."""
    home: dict[str, Any] | None = None

    def plan(self, tries: int) -> StudyPlan:
        count = tries if self.is_declared else min(tries, FEW)
        parameters: dict[str, list[Any]] = {
            "theta": [self.theta],
            "duration_s": [TEN_DAYS_S / self.theta],
            "apad.battery.capacity_wh": [UNLIMITED_WH],
            "fleet.count": self.counts,
            "board.motor_run_charge": [self.surfacing / 2],
        }
        if self.theta == 1:
            parameters["fleet.drift.amplitude_m"] = [0.0]
        if self.home is not None:
            parameters |= {"apad.battery.capacity_wh": [230.0], "apad.home": [self.home]}
        study = {
            "name": f"ten-days-{self.name}",
            "scenarios": ["pool-12.yaml"],
            "strategies": self.strategies,
            "seeds": list(range(FIRST_HELD_OUT, FIRST_HELD_OUT + count)),
            "parameters": parameters,
            "primary": "samples_taken",
        }
        return plan_of(study, self.name, SCENARIOS)


SETTINGS = [
    Setting("theta30-5", 30, [12], 0.05, is_declared=True),
    Setting("theta30-0", 30, [12], 0.0, is_declared=True),
    Setting("theta1-5", 1, [13], 0.05, [BATCH, PARTIAL, TO_FULL, EXCHANGED_TO_FULL], is_declared=True),
    Setting("theta1-home", 1, [12], 0.05, [TO_FULL], home=HOME),
    Setting("capacity-0", 1, [14, 15, 16], 0.0, [PARTIAL, TO_FULL]),
    Setting("capacity-2", 1, [14, 15], 0.02, [PARTIAL, TO_FULL]),
    Setting("capacity-5", 1, [14], 0.05, [PARTIAL, TO_FULL]),
    Setting("capacity-9", 1, [12, 13], 0.09, [PARTIAL, TO_FULL]),
    Setting("theta30-2", 30, [12], 0.02),
    Setting("theta30-9", 30, [12], 0.09),
]
"""The law allows 15.2 aMussels with free surfacing, and 14.7, 13.9 and 12.9 with 2, 5 and 9 %."""


def measure(tries: int = 1, short: bool = False) -> dict[str, Any]:
    """Flies `tries` configurations of the declared comparisons, and at most `FEW` of each other setting."""
    workers = len(os.sched_getaffinity(0))
    settings, processed_s, days, surfacings = SETTINGS, list(PROCESSING_S), list(DAYS), [0.0, 0.05]
    if short:
        tries, settings, processed_s, days, surfacings = 1, SETTINGS[:1], [60], [1], [0.0]
    found = []
    with tempfile.TemporaryDirectory() as passing:
        studies = Path(passing) if short else Path("studies")
        for setting in settings:
            plan = setting.plan(tries)
            rows = fly_study(plan, studies / plan.study.name, workers)
            compared = as_data(plan, comparisons(plan, rows))["settings"]
            found += [told({**it, "seeds": len(plan.seeds)}) for it in compared]
    return {
        "settings": found,
        "duty_cycle": [told(duty_cycle(it, each)) for it in processed_s for each in days],
        "five_apads": [told(five_apads(it, min(tries, FEW))) for it in surfacings],
    }


def duty_cycle(processing_s: int, days: int) -> dict[str, float]:
    """The capacity of `DOCKS` docks for whole boards that wake hourly and process for so long, from some of their days.

    The fleet is the largest that its own law allows; with these docks it draws at least 95 % of the law. It lies within 2 m
    and docks within a second at theta 2, because the law leaves ways out. It begins on the fast part of the curve, as the
    law assumes. The balance begins and ends midway between two wakes, so it has as many wakes as hours.
    """
    laws = {count: bounds_of([_asleep(processing_s, count)]).sustained for count in range(1, TIMESLOTS + 1)}
    count = max(count for count, law in laws.items() if law >= count)
    law, scenario = laws[count], _asleep(processing_s, count)
    before = fly_each_tick(replace(scenario, duration_s=MIDWAY_S / scenario.theta))
    after = fly_each_tick(replace(scenario, duration_s=(MIDWAY_S + days * 86_400) / scenario.theta))
    gained = count * (after.final_charge_mean - before.final_charge_mean)
    drain = fmean(it.drain for it in rates_of(scenario))
    measured = sustained_by_balance(count, gained, drain, days * 1440)
    return {
        "processing_s": processing_s,
        "days": days,
        "amussels": count,
        "law": law,
        "measured": measured,
        "of_law": measured / law,
        "dead_time_h": after.dead_time_h,
    }


def _asleep(processing_s: int, count: int) -> Scenario:
    """`count` whole boards that wake hourly and process for so long, beside an aPad with `DOCKS` docks."""
    data = resolve(load(SCENARIOS / "whole-board-12.yaml"))
    data.update(seed=FIRST_HELD_OUT, theta=2)
    data["area"]["polygon_m"] = [[0, 0], [2, 0], [2, 2], [0, 2]]
    data["apad"].update(start_m=[1, 1], docks=DOCKS)
    data["apad"]["battery"]["capacity_wh"] = UNLIMITED_WH
    data["board"]["whole"]["cycle"].update(alarm_s=3600, sample_s=10, processing_s=processing_s)
    data["mission"].update(
        dispatch="asynchronous", batch=1, pool_threshold=0.7, charge_to=FAST_PART[1], full_when="primary"
    )
    data["mission"]["docking"].update(dock_s=1, undock_s=1)
    data["fleet"].update(count=count, agent_ids=[], start={"charge": list(FAST_PART)})
    return from_data(data, "duty cycle")


def five_apads(surfacing: float, tries: int) -> dict[str, float]:
    """Ten days of five aPads and 120 aMussels in clumps, always awake at theta 1, whose drain is `LOAD` of the law."""
    found = []
    with tempfile.TemporaryDirectory() as folder:
        for seed in range(FIRST_HELD_OUT, FIRST_HELD_OUT + tries):
            scenario = clumped(seed, surfacing, Path(folder))
            found.append((fly_shares(scenario), bounds_of([scenario])))
    each = [it for figures, _ in found for it in figures.values()]
    return {
        "configurations": tries,
        "surfacing": surfacing,
        "law": fmean(bounds.sustained for _, bounds in found),
        "samples_of_bound": fmean(
            sum(it.samples_taken for it in figures.values()) / (bounds.samples or 1)
            for figures, bounds in found
        ),
        "lost": max(sum(it.amussels_lost for it in figures.values()) for figures, _ in found),
        "dead_time_h": sum(it.dead_time_h for it in each),
        "uptime_mean": fmean(it.uptime_paper_mean for it in each),
        "uptime_least": min(it.uptime_paper_min for it in each),
        "metres": sum(it.metres for it in each) / tries,
    }


def clumped(seed: int, surfacing: float, folder: Path) -> Scenario:
    """bay-120 with its aMussels in `CLUMPS` clumps of `CLUMP_M` metres at random places."""
    data = resolve(load(SCENARIOS / "bay-120.yaml"))
    data.update(seed=seed, theta=1, duration_s=TEN_DAYS_S)
    data["fleet"]["drift"]["amplitude_m"] = 0.0
    data["apad"]["battery"]["capacity_wh"] = UNLIMITED_WH
    data["mission"].update({key: value for key, value in PARTIAL.items() if key != "name"})
    data["board"]["motor_run_charge"] = surfacing / 2
    scenario = from_data(data, "five aPads")
    docks, count = scenario.apad.docks * (1 + len(scenario.apads)), scenario.fleet.count
    data["board"]["discharge_per_min"] = round(
        drain_at_load(rates_of(scenario)[0].charge, count, docks, LOAD), 10
    )
    path = folder / f"{seed}-{surfacing}.csv"
    save_starts(path, _in_clumps(starts_of(scenario), seed), scenario.area.origin)
    data["fleet"]["start"] = str(path)
    return from_data(data, "five aPads")


def _in_clumps(starts: Sequence[Start], seed: int) -> list[Start]:
    chance = Random(seed)
    centres = [
        (chance.uniform(CLUMP_M, 60 - CLUMP_M), chance.uniform(CLUMP_M, 200 - CLUMP_M)) for _ in range(CLUMPS)
    ]
    found = []
    for it in starts:
        (north_m, east_m), way_m, angle = (
            chance.choice(centres),
            CLUMP_M * chance.random() ** 0.5,
            chance.uniform(0, 2 * pi),
        )
        found.append(
            Start(it.agent_id, north_m + way_m * cos(angle), east_m + way_m * sin(angle), it.primary)
        )
    return found


def show(result: dict[str, Any], console: Console) -> None:
    for setting in result["settings"]:
        bounds = setting["bounds"]
        table = Table(
            title=f"{setting['setting']}, {setting['seeds']} configurations: the docks sustain {bounds['sustained']:.1f}, "
            f"nobody exceeds {bounds['samples']:.0f} samples and {bounds['uptime_percent']:.1f} % uptime"
        )
        for name in ("", "of the bound", *(HEADINGS[key] for key in COLUMNS)):
            table.add_column(name, justify="right" if name else "left")
        for standing in setting["strategies"]:
            share = standing["columns"]["samples_taken"]["mean"] / bounds["samples"]
            cells = (_cell(standing["columns"][key]) for key in COLUMNS)
            table.add_row(standing["strategy"], f"{share:.1%}", *cells)
        console.print(table)
        for standing in setting["strategies"]:
            for key, difference in standing["differences"].items():
                if difference is not None and key in ("samples_taken", "uptime_paper_mean", "metres"):
                    p = "" if difference["p"] is None else f", p {difference['p']:.2g}"
                    console.print(
                        f"{standing['strategy']}, {HEADINGS[key]} less the batches': {_cell(difference['estimate'])}{p}"
                    )
    for duty in result["duty_cycle"]:
        console.print(
            f"{duty['amussels']} whole boards that process {duty['processing_s']} s an hour, {DOCKS} docks, "
            f"{duty['days']} days: measured {duty['measured']:.1f} aMussels, the law allows {duty['law']:.1f} "
            f"({duty['of_law']:.1%})"
        )
    for it in result["five_apads"]:
        console.print(
            f"Five aPads, 120 aMussels, {it['surfacing']:.0%} a surfacing, {it['configurations']} configurations: "
            f"{it['lost']} lost, {it['dead_time_h']:.0f} dead h, {it['samples_of_bound']:.1%} of the bound's samples, "
            f"uptime {it['uptime_mean']:.1f} %, the least {it['uptime_least']:.1f} %, {it['metres']:.0f} m"
        )


def _cell(estimate: dict[str, Any] | None) -> str:
    if estimate is None:
        return "–"
    half = "" if estimate["high"] is None else f" +- {estimate['high'] - estimate['mean']:.2g}"
    return f"{estimate['mean']:.4g}{half}"
