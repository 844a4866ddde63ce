"""The phase diagram of a fleet: from which sizes and start charges the docks hold it, and from which it stays low.

The bound D (1 + c / d) of `capacity` takes the fastest part of the charging curve. A fleet whose charges are low charges on
the slow part below the curve's knee, so that its docks give less than it draws. So it stays low, though a fleet of the same
size that began high is held for ever. Each flight of the diagram begins with charges drawn evenly about a mean. It counts
as held if no aMussel is empty in the last fifth of its ten days.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from statistics import fmean
from typing import Any

from rich.table import Table

from apad_bridge.analysis.report.report_figures import as_file
from apad_bridge.assembly.capacity_bounds import Bounds
from apad_bridge.planning.registry import Trust
from apad_bridge.scenario.loader import SHIPPED, with_values
from apad_bridge.scenario.schema import Scenario
from apad_bridge.scenario.text.text_file import write_atomically
from apad_bridge.studies.findings import Findings, table_of
from apad_bridge.studies.models import Model, fly
from apad_bridge.studies.runner import Row
from apad_bridge.studies.specification import StudyPlan, plan_of

AMUSSELS = range(9, 17)
"""About the pool's two bounds: 11.9 if each charge begins at empty, and 15.2."""
MEAN_CHARGES = (0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8)
SPREAD = 0.2
"""Starts are drawn evenly within this of the mean, as the paper's of 0.6 to 1. Equal charges would all be due at once."""
DAYS_S = 10 * 86_400
UNLIMITED_WH = 1e6
"""The aPad's battery, which is no part of the question. The random drift is none either: it moves an aMussel by less than a
metre between two services, and takes most of a flight's time."""
_ONE_BY_ONE = {
    "name": "cautious, one by one",
    "collection": "cautious",
    "dispatch": "asynchronous",
    "pool_threshold": 0.7,
}
_BATCH = {"name": "cautious, batch", "collection": "cautious"}
_DIAGRAM = "diagram.svg"


@dataclass(frozen=True, slots=True)
class SizedFlights:
    """The flights of one strategy from one size of the fleet and one mean start charge."""

    strategy: str
    amussels: int
    start_charge: float
    flown: int
    held: int
    """Flights without an empty aMussel in their last fifth."""
    uptime_percent: float
    dead_late_h: float
    """Mean hours of aMussels with an empty battery in the last fifth: agent time, over the fleet."""


def capacity_study(seeds: int = 5) -> StudyPlan:
    """The diagram's study: the pool at theta 1 for ten days, with two rules of dispatch.

    It has 112 cells, and a flight of ten days takes about a second of a processor.
    """
    data = {
        "name": "capacity",
        "scenarios": ["pool-12.yaml"],
        "strategies": [_ONE_BY_ONE, _BATCH],
        "seeds": seeds,
        "start": "scenario",
        "parameters": {
            "theta": [1],
            "duration_s": [float(DAYS_S)],
            "apad.battery.capacity_wh": [UNLIMITED_WH],
            "fleet.drift.amplitude_m": [0.0],
            "fleet.count": list(AMUSSELS),
            "fleet.start": [_start(it) for it in MEAN_CHARGES],
        },
        "model": Model.EVENT_DRIVEN.value,
    }
    return plan_of(data, "capacity", SHIPPED)


def _start(mean: float) -> dict[str, Any]:
    return {"charge": [round(mean - SPREAD, 6), round(mean + SPREAD, 6)]}


def phases_of(plan: StudyPlan, rows: Sequence[Row]) -> list[SizedFlights]:
    """One for each strategy, size and start charge, in the study's order."""
    found = []
    for strategy in plan.strategies:
        for index, setting in enumerate(plan.settings):
            own = [row for row in rows if row["setting"] == index and row["strategy"] == strategy]
            values: dict[str, Any] = dict(setting.parameters)
            found.append(
                SizedFlights(
                    strategy=strategy,
                    amussels=values["fleet.count"],
                    start_charge=round(fmean(values["fleet.start"]["charge"]), 6),
                    flown=len(own),
                    held=sum(row["dead_late_h"] == 0 for row in own),
                    uptime_percent=fmean(row["uptime_paper_mean"] for row in own),
                    dead_late_h=fmean(row["dead_late_h"] for row in own),
                )
            )
    return found


def held_from(phases: Sequence[SizedFlights]) -> float | None:
    """The least mean start charge of one fleet from which on every flight is held; None if not even the highest is."""
    least = None
    for phase in sorted(phases, key=lambda it: -it.start_charge):
        if phase.held < phase.flown:
            break
        least = phase.start_charge
    return least


def borders_of(phases: Sequence[SizedFlights]) -> Iterator[tuple[str, int, float | None]]:
    """(strategy, aMussels, `held_from`) for each fleet of the diagram."""
    for strategy, amussels in dict.fromkeys((it.strategy, it.amussels) for it in phases):
        own = [it for it in phases if (it.strategy, it.amussels) == (strategy, amussels)]
        yield strategy, amussels, held_from(own)


def diagram_of(scenario: Scenario, seeds: Sequence[int], trust: Trust | None = None) -> list[SizedFlights]:
    """Flies the scenario's own fleet by its own rules for ten days of the aMussels' time, from each start charge.

    The aPad's battery is unlimited, and nothing drifts at random. Strategies in files are executed with `trust` alone.

    StrategyFailed when its strategy ends a flight. The scenario must be one that `model_gap` finds covered.
    """
    values = {
        "duration_s": float(scenario.time_scale.mission_time(DAYS_S)),
        "apad.battery.capacity_wh": UNLIMITED_WH,
        "fleet.drift.amplitude_m": 0.0,
    }
    found = []
    for mean in MEAN_CHARGES:
        flights = []
        for seed in seeds:
            seeded = with_values(
                scenario, {**values, "fleet.start": _start(mean), "seed": seed}, scenario.name
            )
            flights.append(fly(seeded, Model.EVENT_DRIVEN, trust))
        found.append(
            SizedFlights(
                strategy=scenario.mission.collection,
                amussels=len(scenario.fleet.ids),
                start_charge=mean,
                flown=len(flights),
                held=sum(it.dead_late_h == 0 for it in flights),
                uptime_percent=fmean(it.uptime_paper_mean for it in flights),
                dead_late_h=fmean(it.dead_late_h for it in flights),
            )
        )
    return found


def write_diagram(path: Path, phases: Sequence[SizedFlights], bounds: Bounds, made_by: str) -> None:
    """Writes the diagram as SVG: a panel for each strategy, and the share of flights that were held as colour.

    The file names `made_by`, the command.
    """
    import matplotlib

    matplotlib.use("svg")
    from matplotlib.figure import Figure
    from matplotlib.patheffects import withStroke

    matplotlib.rcParams["svg.hashsalt"] = "musselbed"  # so that the same diagram is the same file
    strategies = list(dict.fromkeys(it.strategy for it in phases))
    sizes = sorted({it.amussels for it in phases})
    charges = sorted({it.start_charge for it in phases})
    drawing = Figure(figsize=(4.6 * len(strategies), 3.8), layout="constrained")
    for axis, strategy in zip(
        drawing.subplots(1, len(strategies), squeeze=False)[0], strategies, strict=True
    ):
        shares = {
            (it.amussels, it.start_charge): it.held / it.flown for it in phases if it.strategy == strategy
        }
        grid = [[shares[size, charge] for size in sizes] for charge in charges]
        mesh = axis.pcolormesh(sizes, charges, grid, cmap="RdYlBu", vmin=0, vmax=1, edgecolors="white")
        for bound, style, name in (
            (bounds.sustained_from_empty, ":", "sustained if each charge begins at empty"),
            (bounds.sustained, "--", "sustained at most"),
        ):
            line = axis.axvline(bound, linestyle=style, color="black", label=name)
            line.set_path_effects([withStroke(linewidth=4, foreground="white")])
        axis.set_title(strategy)
        axis.set_xlabel("aMussels")
        axis.set_xticks(sizes)
        axis.set_yticks(charges)
        axis.set_ylabel("mean charge at the start")
    drawing.colorbar(mesh, label="share of flights that are held")
    drawing.legend(handles=axis.lines, loc="outside lower center", ncols=2, frameon=False)
    write_atomically(path, as_file(drawing, made_by))


class CapacityDiagram(Findings):
    """The diagram in place of a page, which would have figures for each of the many settings and say less."""

    def __init__(self, plan: StudyPlan, rows: Sequence[Row]) -> None:
        super().__init__(plan, rows)
        self.phases = phases_of(plan, rows)
        self.bounds = self.compared[0].bounds

    def as_data(self) -> dict[str, Any]:
        return {**super().as_data(), "phases": [asdict(it) for it in self.phases]}

    def lines(self, width: int) -> Iterator[Table | str]:
        """A table for each strategy: the flights that were held, by size of the fleet and mean charge at the start."""
        charges = sorted({it.start_charge for it in self.phases})
        for strategy in self.plan.strategies:
            own = {(it.amussels, it.start_charge): it for it in self.phases if it.strategy == strategy}
            title = f"{strategy}: flights held, of {self.phases[0].flown}, by mean charge at the start"
            table = table_of(title, ["aMussels", *(f"{it:g}" for it in charges), "held from"])
            for _, amussels, least in borders_of(list(own.values())):
                cells = [str(own[amussels, it].held) for it in charges]
                table.add_row(str(amussels), *cells, "never" if least is None else f"{least:g}")
            yield table
        yield (
            f"The docks sustain at most {self.bounds.sustained:.1f} aMussels, and {self.bounds.sustained_from_empty:.1f} "
            "if each charge begins at empty. Between the two it depends on the start: a fleet that begins low stays low."
        )

    def write_figures(self, directory: Path) -> str:
        write_diagram(directory / _DIAGRAM, self.phases, self.bounds, "musselbed study capacity")
        return f"The diagram: {directory / _DIAGRAM}"
