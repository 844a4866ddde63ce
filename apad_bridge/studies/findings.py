"""A study's findings for its readers: a terminal, `--json`, and a file with figures.

`Findings` compares the strategies, which is all that a study of a file asks. A built-in study has a subclass beside its
plan, which overrides what its own answer adds or replaces. `musselbed study` knows no more of it.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from rich.box import SIMPLE_HEAD
from rich.table import Table

from apad_bridge.studies.mission_figures import COLUMNS
from apad_bridge.studies.runner import Row
from apad_bridge.studies.specification import StudyPlan
from apad_bridge.studies.study_report import (
    HEADINGS,
    NO_ENERGY,
    REPORT,
    Comparison,
    as_data,
    comparisons,
    difference_text,
    estimate_text,
    that_fit,
    verdict,
    write_report,
)
from apad_bridge.studies.sweep_figure import draw, sweep_of

_PAGE_MM = 160.0
"""The width of the figure over a parameter, on the page."""


class Findings:
    """The findings of a study whose missions were flown: its strategies, compared in each setting."""

    def __init__(self, plan: StudyPlan, rows: Sequence[Row]) -> None:
        self.plan = plan
        self.rows = rows
        self.compared = comparisons(plan, rows)
        self.sweep = sweep_of(plan, rows)

    def as_data(self) -> dict[str, Any]:
        """The keys of `--json`, as plain data."""
        return as_data(self.plan, self.compared)

    def answer(self) -> Sequence[str]:
        """The study's own answer, the same for the terminal and the page: sentences, and lines that belong together."""
        return ()

    def lines(self, width: int) -> Iterator[Table | str]:
        """The tables and sentences for a terminal of so many columns, in their order."""
        for each in self.compared:
            yield from _comparison_lines(each, self.plan, width)
        if self.sweep is not None:
            head, *rows = self.sweep.cells()
            table = table_of(
                f"over {self.sweep.key}, on the same configurations; p-values by Holm over this table", head
            )
            for cells in rows:
                table.add_row(*cells)
            yield table

    def write_figures(self, directory: Path) -> str:
        """Writes the file with figures, and returns a sentence that names it. OSError if it cannot be written."""
        path = directory / REPORT
        sweep = None if self.sweep is None else draw(self.sweep, _PAGE_MM)
        write_report(path, self.plan, self.rows, self.compared, self.answer(), sweep)
        return f"Tables and figures, for a browser: {path}"


def table_of(title: str, headings: Sequence[str]) -> Table:
    """An empty table in the form of all studies: numbers to the right, and no line for a frame."""
    table = Table(title=title, title_justify="left", box=SIMPLE_HEAD, pad_edge=False)
    for heading in headings:
        table.add_column(heading, justify="right" if heading else "left", no_wrap=True)
    return table


def _comparison_lines(found: Comparison, plan: StudyPlan, width: int) -> Iterator[Table | str]:
    """A row for each column, so that the strategies fit beside each other on a narrow terminal; then the verdict."""
    baseline = plan.baseline
    means = {it.strategy: [estimate_text(it.columns[column]) for column in COLUMNS] for it in found.standings}
    differences = {
        it.strategy: [difference_text(it.differences[column]) for column in COLUMNS]
        for it in found.standings
        if it.differences
    }
    titles = (f"{found.setting.label}, best first", f"minus {baseline}, on the same configurations")
    for title, cells in zip(titles, (means, differences), strict=True):
        for strategies in that_fit(cells, width - max(map(len, HEADINGS.values()))):
            table = table_of(title, ["", *strategies])
            for row, column in enumerate(COLUMNS):
                table.add_row(HEADINGS[column], *(cells[it][row] for it in strategies))
            yield table
    yield verdict(found, plan)
    yield found.bounds.text
    if found.setting.theta != 1:
        yield f"{NO_ENERGY}."
    yield ""
