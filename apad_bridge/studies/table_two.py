"""The paper's Table II as a study: its scenarios on many random configurations, and where its values lie among them.

One run proves little: average uptime alone varies by a point or more between configurations. A flight that is recorded for
its whole known length obeys Active = N * Avg / 100. In the two Greedy rows the ratios are 1.032 and 0.940, as if 38.8 and
42.6 of 40 minutes had been recorded. `fitted_starts` flies them so; here they are flown for 40 minutes.
"""

from __future__ import annotations

import itertools
import statistics
from bisect import bisect_right
from collections.abc import Iterator, Sequence
from typing import Any

from rich.table import Table

from agents.time_scale import TimeScale
from apad_bridge.scenario.loader import SHIPPED
from apad_bridge.scenario.paper_rows import PAPER
from apad_bridge.studies.findings import Findings, table_of
from apad_bridge.studies.runner import Row
from apad_bridge.studies.specification import StudyPlan, plan_of

THETA = 30
"""The paper's time scale, at which alone its figures compare with ours."""
_APAD_WH = 230.0
"""The battery of the scenarios' aPad."""
_BATTERY_FACTOR = 10
"""At another theta the aPad's battery is so much larger, because it would not last as long as the aMussels' 20 hours."""
CHARGES = {"charges of 0.6 to 1": [0.6, 1.0], "charges as without charging": [0.709, 0.996]}
"""Intervals of the starting charges: the paper's words (section V-A), and what its row without charging implies.

There uptime is charge over drain: the least charge is 0.709, the greatest 0.996 and the mean 0.843."""
COLUMNS = {"mean": "Avg %", "max": "Max %", "min": "Min %", "cost_m": "Cost m", "active_mean": "Active"}
FIGURES = {
    "mean": "uptime_paper_mean",
    "max": "uptime_paper_max",
    "min": "uptime_paper_min",
    "cost_m": "metres",  # the paper adds up straight legs
    "active_mean": "active_mean",
}
BESIDE = {"dead_time_h": "Dead h", "longest_gap_h": "Gap h"}
"""Columns of ours beside the paper's: uptime hides an aMussel that stands empty, or that took no sample for long."""


def table_two_study(seeds: int = 200, theta: int = THETA) -> StudyPlan:
    """The study of Table II: the pool and the bay with each strategy and each of `CHARGES`; 20 hours of the aMussels' time.

    Another theta than the paper's is part of its name, so the two have directories of their own.
    """
    parameters: dict[str, list[Any]] = {}
    if theta != THETA:
        parameters = {
            "theta": [theta],
            "duration_s": [TimeScale(theta).mission_time(TimeScale(THETA).agent_time(2400.0))],
            "apad.battery.capacity_wh": [_APAD_WH * _BATTERY_FACTOR],
        }
    data = {
        "name": "table2" if theta == THETA else f"table2-theta{theta}",
        "scenarios": ["pool-12.yaml", "bay-24.yaml"],
        "strategies": ["cautious", "greedy", "none"],
        "seeds": seeds,
        "parameters": parameters,
        "cells": {name: {"fleet.start.charge": charges} for name, charges in CHARGES.items()},
    }
    return plan_of(data, "table2", SHIPPED)


def table_two(plan: StudyPlan, rows: Sequence[Row]) -> list[dict[str, Any]]:
    """For each of `CHARGES`, row and column of the paper's table: its value, ours, and the percentile of its among ours.

    `percentile` is None at another theta than the paper's, where all of ours are equal, and for columns of ours alone.
    """
    found = []
    for charges, paper in itertools.product(CHARGES, PAPER):
        ours = [
            row
            for row in rows
            if plan.settings[row["setting"]].scenario == paper.scenario
            and dict(plan.settings[row["setting"]].parameters)["cell"] == charges
            and row["strategy"] == paper.collection
        ]
        is_papers = plan.settings[ours[0]["setting"]].theta == THETA
        for column, figure in (FIGURES | {it: it for it in BESIDE}).items():
            values = [row[figure] for row in ours]
            compared: dict[str, Any] = {"charges": charges, "row": paper.name, "column": column}
            compared |= beside(getattr(paper, column, None), values)
            if not is_papers or min(values) == max(values):
                compared["percentile"] = None
            found.append({**compared, "paper_recorded": paper.recorded})
    return found


def beside(papers: float | None, ours: Sequence[float]) -> dict[str, Any]:
    """The paper's value, our median and central 90 %, and the percentile of the paper's value among ours.

    The value and the percentile are None for a column that the paper does not have.
    """
    values = sorted(ours)
    return {
        "paper": papers,
        "median": statistics.median(values),
        "p5": values[int(0.05 * len(values))],
        "p95": values[min(len(values) - 1, int(0.95 * len(values)))],
        "percentile": None if papers is None else percentile_of(papers, values),
    }


def notes() -> list[str]:
    """A line for each row of the paper that reads as if another time than the mission's had been recorded."""
    return [
        f"the paper's row {it.name} has an Active of {it.active_mean:.2f}, {it.ratio:.3f} times {it.amussels} x "
        f"{it.mean:.2f} / 100, as if {40 * it.recorded:.1f} of 40 minutes had been recorded: see --fit"
        for it in PAPER
        if it.recorded != 1
    ]


def apad_energy(plan: StudyPlan, rows: Sequence[Row]) -> str | None:
    """At theta 1, the aPad's energy in a mission; None at any other, where it compares with nothing."""
    used_wh = [row["apad_wh"] for row in rows if row["strategy"] == "cautious" and row["setting"] == 0]
    if None in used_wh or not used_wh:
        return None
    mean_wh = statistics.fmean(used_wh)
    return (
        f"Cautious in the pool takes {mean_wh:.0f} Wh of the aPad: {mean_wh / _APAD_WH:.1f} charge cycles of its "
        f"{_APAD_WH:g} Wh, flown with {_BATTERY_FACTOR} times as much"
    )


def percentile_of(value: float, sample: Sequence[float]) -> float:
    """The fraction of `sample` that is at most `value`, in percent."""
    return 100 * bisect_right(sorted(sample), value) / len(sample)


class TableTwo(Findings):
    """The paper's table beside ours, and then the comparison of the strategies."""

    def as_data(self) -> dict[str, Any]:
        return {**super().as_data(), "table2": table_two(self.plan, self.rows), "notes": notes()}

    def lines(self, width: int) -> Iterator[Table | str]:
        compared = table_two(self.plan, self.rows)
        is_papers = any(it["percentile"] is not None for it in compared)
        title = "the paper's Table II beside ours, and the percentile of each of its values among ours"
        if not is_papers:
            title = f"Table II at another theta: the paper's figures are at {THETA}, so these do not compare"
        shown = {"median": "ours, median", "p5": "ours, 5 %", "p95": "ours, 95 %"}
        if is_papers:
            shown = {"paper": "paper", **shown, "percentile": "percentile"}
        for charges in CHARGES:
            table = table_of(f"{title}; {charges}", ["", *COLUMNS.values(), *BESIDE.values()])
            for row in PAPER:
                mark = " *" if row.recorded != 1 and is_papers else ""
                table.add_row(f"{row.name}{mark}", style="bold")
                cells = {
                    it["column"]: it for it in compared if (it["charges"], it["row"]) == (charges, row.name)
                }
                for key, heading in shown.items():
                    values = [cells[column][key] for column in (*COLUMNS, *BESIDE)]
                    table.add_row(f"  {heading}", *("–" if it is None else f"{it:.2f}" for it in values))
            yield table
        for note in notes() if is_papers else ():
            yield f"* {note}"
        if (energy := apad_energy(self.plan, self.rows)) is not None:
            yield energy
        yield ""
        yield from super().lines(width)
