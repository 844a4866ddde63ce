"""A study's primary figure over the one parameter that it varies: paired differences, a figure and a table."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from apad_bridge.studies.runner import Row
from apad_bridge.studies.specification import StudyPlan
from apad_bridge.studies.statistics import Difference, Estimate, difference_of, estimate_of, holm_adjusted
from apad_bridge.studies.study_report import HEADINGS, difference_text, estimate_text

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FIGURE_FORMATS, TABLE_FORMATS = (".pdf", ".svg"), ("latex", "csv")
_MM_PER_INCH = 25.4
_HEIGHT = 0.72
"""The height of a figure, by its width."""
_APART = 0.015
"""The distance of two strategies at one value, by the parameter's range."""
_LINE = {"markersize": 3, "capsize": 2, "linewidth": 1}
_EMBEDDED: Any = {"svg.fonttype": "path", "svg.hashsalt": "musselbed", "pdf.fonttype": 42}
"""Fonts as a press wants them, and the same bytes at each writing."""
_LATEX = {it: f"\\{it}" for it in "#$%&_{}"} | {
    "±": "$\\pm$",
    "–": "--",
    "<": "$<$",
    "~": r"\textasciitilde{}",
}


@dataclass(frozen=True, slots=True)
class SweepPoint:
    """One strategy at one value. `difference` is to the study's first value, on the same seeds; None at that value."""

    scenario: str
    strategy: str
    value: Any
    estimate: Estimate | None
    difference: Difference | None


@dataclass(frozen=True, slots=True)
class Sweep:
    """The points by scenario, then strategy, then value. p-values are adjusted by Holm over all of them."""

    key: str
    column: str
    confidence: float
    points: tuple[SweepPoint, ...]

    @property
    def lines(self) -> Iterator[tuple[str, list[SweepPoint]]]:
        """The points of each scenario and strategy with their name: of what varies in the study."""
        names = list(dict.fromkeys((it.scenario, it.strategy) for it in self.points))
        scenarios, strategies = ({name[n] for name in names} for n in (0, 1))
        for name in names:
            parts = [*([name[0]] if len(scenarios) > 1 else []), *([name[1]] if len(strategies) > 1 else [])]
            yield ", ".join(parts), [it for it in self.points if (it.scenario, it.strategy) == name]

    def cells(self) -> Iterator[list[str]]:
        """The table as texts, its headings first: a row for each point."""
        lines = list(self.lines)
        has_names = len(lines) > 1
        yield [
            *(["strategy"] if has_names else []),
            self.key,
            HEADINGS[self.column],
            f"minus {lines[0][1][0].value}",
        ]
        for name, points in lines:
            for it in points:
                difference = "" if it is points[0] else difference_text(it.difference)
                yield [*([name] if has_names else []), str(it.value), estimate_text(it.estimate), difference]


def swept_key(plan: StudyPlan) -> str | None:
    """The one parameter with several values, or None. Figures at different theta do not compare."""
    keys = [key for key, values in plan.study.parameters.items() if len(values) > 1]
    return keys[0] if len(keys) == 1 and keys != ["theta"] and len(plan.study.cells) < 2 else None


def sweep_of(plan: StudyPlan, rows: Sequence[Row]) -> Sweep | None:
    """The study's sweep; None for a study that varies no one parameter."""
    if (key := swept_key(plan)) is None:
        return None
    points: list[SweepPoint] = []
    for scenario in dict.fromkeys(it.scenario for it in plan.settings):
        settings = [n for n, it in enumerate(plan.settings) if it.scenario == scenario]
        for strategy in plan.strategies:
            own = [
                {row["seed"]: row for row in rows if row["setting"] == n and row["strategy"] == strategy}
                for n in settings
            ]
            points += _line(
                plan, scenario, strategy, [dict(plan.settings[n].parameters)[key] for n in settings], own
            )
    column, adjusted = plan.study.primary, iter(holm_adjusted([it.difference for it in points]))
    whole = tuple(
        SweepPoint(it.scenario, it.strategy, it.value, it.estimate, next(adjusted)) for it in points
    )
    return Sweep(key, column, plan.study.confidence, whole)


def _line(
    plan: StudyPlan, scenario: str, strategy: str, values: Sequence[Any], rows: Sequence[dict[int, Row]]
) -> Iterator[SweepPoint]:
    column, confidence = plan.study.primary, plan.study.confidence
    for value, own in zip(values, rows, strict=True):
        estimate = estimate_of([row[column] for row in own.values()], confidence)
        difference = None if own is rows[0] else difference_of(own, rows[0], column, confidence)
        yield SweepPoint(scenario, strategy, value, estimate, difference)


def draw(sweep: Sweep, width_mm: float) -> Figure:
    """The figure over the parameter, on one axis, with the intervals of the means."""
    import matplotlib
    from matplotlib.figure import Figure

    width = width_mm / _MM_PER_INCH
    drawing = Figure(figsize=(width, _HEIGHT * width), layout="constrained")
    with matplotlib.rc_context({"font.size": 8}):
        axis = drawing.subplots()
        _draw_lines(axis, sweep)
        axis.set(xlabel=sweep.key, ylabel=HEADINGS[sweep.column])
        axis.grid(axis="y", linewidth=0.4, alpha=0.5)
        if len(list(sweep.lines)) > 1:
            axis.legend(frameon=False)
    return drawing


def _draw_lines(axis: Any, sweep: Sweep) -> None:
    """The strategies beside each other at each value, so that no interval hides another."""
    values = list(dict.fromkeys(str(it.value) for it in sweep.points))
    is_number = all(type(it.value) in (int, float) for it in sweep.points)
    places = [it.value if is_number else values.index(str(it.value)) for it in sweep.points]
    apart, lines = _APART * (max(places) - min(places)), list(sweep.lines)
    for n, (name, points) in enumerate(lines):
        known = [
            (it.value if is_number else values.index(str(it.value)), it.estimate)
            for it in points
            if it.estimate
        ]
        places = [place + apart * (n - (len(lines) - 1) / 2) for place, _ in known]
        reach = [(it.high - it.low) / 2 for _, it in known]
        axis.errorbar(places, [it.mean for _, it in known], yerr=reach, marker="o", label=name, **_LINE)
    if not is_number:
        axis.set_xticks(range(len(values)), values)


def write_figure(sweep: Sweep, path: Path, width_mm: float) -> None:
    """Writes a PDF or SVG of this width."""
    import matplotlib

    dated = {"CreationDate": None} if path.suffix == ".pdf" else {"Date": None}
    with matplotlib.rc_context(_EMBEDDED):
        draw(sweep, width_mm).savefig(path, metadata=dated)


def as_table(sweep: Sweep, form: str) -> str:
    """The table as LaTeX with booktabs' rules, or as CSV with a column for each number."""
    return _as_latex(sweep) if form == "latex" else _as_csv(sweep)


def _as_latex(sweep: Sweep) -> str:
    head, *rows = [" & ".join(map(_escaped, cells)) + r" \\" for cells in sweep.cells()]
    columns = "l" * (len(next(sweep.cells())) - 2) + "rr"
    return "\n".join(
        [
            rf"\begin{{tabular}}{{{columns}}}",
            r"\toprule",
            head,
            r"\midrule",
            *rows,
            r"\bottomrule",
            r"\end{tabular}",
        ]
    )


def _escaped(text: str) -> str:
    is_negative = text.startswith("-")
    plain = text.removeprefix("-").replace("\\", "/")
    return is_negative * "$-$" + "".join(_LATEX.get(it, it) for it in plain)


def _as_csv(sweep: Sweep) -> str:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    spread = ["mean", "low", "high"]
    writer.writerow(
        ["scenario", "strategy", sweep.key, "count", *spread, *(f"difference_{it}" for it in spread), "p"]
    )
    for it in sweep.points:
        own, other = it.estimate, it.difference
        numbers: list[float | None] = [None] * 4 if own is None else [own.count, own.mean, own.low, own.high]
        numbers += (
            [None] * 4
            if other is None
            else [other.estimate.mean, other.estimate.low, other.estimate.high, other.p]
        )
        writer.writerow([it.scenario, it.strategy, it.value, *numbers])
    return text.getvalue().rstrip("\n")
