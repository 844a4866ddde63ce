"""Writes a report of one run or several: one HTML page, one PDF, with the same tables and figures."""

from __future__ import annotations

import base64
import io
from collections.abc import Callable, Iterator, Mapping, Sequence
from html import escape
from math import fsum
from pathlib import Path
from typing import Any, NamedTuple

from apad_bridge.analysis.belief_scores import figure as belief_figure
from apad_bridge.analysis.belief_scores.scores import Score
from apad_bridge.analysis.energy.energy import AgentEnergy, summed
from apad_bridge.analysis.report import figures
from apad_bridge.analysis.report.contents import RunReport, Told
from apad_bridge.scenario.text_file import write_atomically

PAGE, PDF = "report.html", "report.pdf"
_ROWS_A_PAGE = 34
"""Rows of a table on one page of the PDF."""
_COLUMNS = (
    *("run", "strategies", "theta", "seed", "aMussels"),
    *("avg %", "max %", "min %", "cost m", "driven m", "active"),
    *("served", "emptied", "lost", "given up", "ended by"),
)


class Table(NamedTuple):
    title: str
    columns: Sequence[str]
    rows: Sequence[Sequence[str]]
    note: str = ""


Part = Table | Any
"""A table, or a figure of matplotlib."""


def write_report(reports: Sequence[RunReport], folder: Path) -> tuple[Path, Path]:
    """Writes `report.html`, which needs no other file, and `report.pdf`; returns both paths. OSError."""
    folder.mkdir(parents=True, exist_ok=True)
    parts = list(_parts(reports))
    names = ", ".join(report.name for report in reports)
    body = "\n".join(_html_table(it) if isinstance(it, Table) else _html_figure(it) for it in parts)
    write_atomically(folder / PAGE, _PAGE.format(title=escape(f"Report: {names}"), body=body))
    _write_pdf(parts, folder / PDF, f"Report: {names}")
    return folder / PAGE, folder / PDF


def _parts(reports: Sequence[RunReport]) -> Iterator[Part]:
    yield Table(
        "Runs",
        _COLUMNS,
        [_row(it) for it in reports],
        "avg, max and min: uptime as the paper counts it; cost: the straight legs that were ordered. The figures of a run "
        "that was stopped are those of no whole flight; its stops are shaded.",
    )
    yield figures.activity(reports)
    for report in reports:
        yield figures.places(report)
        yield figures.batteries(report)
        if report.energy:
            yield figures.energy(report)
            yield _energy_table(report, "module", lambda it: it.by_module)
            yield _energy_table(report, "state", lambda it: it.by_state)
        if report.scores is not None:
            yield _belief_table(report)
            yield belief_figure.figure_of(report.scores, f"{report.name}: beliefs")
        yield _trouble_table(report)


def _row(report: RunReport) -> list[str]:
    data, known = report.data, report.summary or {}
    uptime = known.get("uptime_paper") or {}
    ended = data["ended_by"] or "has not ended"
    return [
        report.name,
        f"{data['collection']} / {data['redeployment']}",
        *(f"{data[key]}" for key in ("theta", "seed")),
        str(len(data["agents"])),
        *(_number(uptime.get(key), ".2f") for key in ("mean", "max", "min")),
        *(_number(known.get(key), ".2f") for key in ("planned_m", "cost_m", "active_mean")),
        *(_number(known.get(key), "d") for key in ("services", "emptied", "amussels_lost", "steps_given_up")),
        f"stopped for {stopped_s:g} s; {ended}" if (stopped_s := known.get("stopped_s")) else ended,
    ]


def _number(value: float | None, form: str) -> str:
    return "–" if value is None else format(value, form)


def _energy_table(report: RunReport, by: str, of: Callable[[AgentEnergy], Mapping[str, float]]) -> Table:
    totals, count = summed(report.energy, of), len(report.energy)
    whole = fsum(totals.values()) or 1.0
    rows = [
        (name.replace("_", " "), f"{100 * drawn / count:.3f}", f"{100 * drawn / whole:.1f}")
        for name, drawn in totals.items()
    ]
    strange = [str(it.agent_id) for it in report.energy if not it.is_exact]
    note = f"aMussels {', '.join(strange)} went another way than the journal says" if strange else ""
    return Table(f"{report.name}: energy by {by}", (by, "% of a battery, mean", "share %"), rows, note)


def _belief_table(report: RunReport) -> Table:
    assert report.scores is not None
    scores = report.scores
    groups = {
        "": {"all": scores.overall},
        "packet up to ": scores.by_age,
        "mode ": scores.by_mode,
    }
    rows = [_score_row(f"{head}{name}", it) for head, bins in groups.items() for name, it in bins.items()]
    columns = ("", "samples", "rmse", "bias", "in the interval of 95 %", "mode right", "place rmse m")
    return Table(f"{report.name}: charges believed, less true ones", columns, rows)


def _score_row(name: str, score: Score) -> list[str]:
    return [
        name,
        str(score.samples),
        *(f"{it:+.4f}" if it is score.bias else f"{it:.4f}" for it in (score.rmse, score.bias)),
        _number(score.coverage, ".3f"),
        f"{score.mode_right:.3f}",
        _number(score.place_rmse_m, ".2f"),
    ]


def _trouble_table(report: RunReport) -> Table:
    rows = [
        (clock(fault.at_ms), fault.text, "; ".join(f"{_later(it, fault)} {it.text}" for it in followed))
        for fault, followed in report.troubles
    ]
    note = "None." if not rows else f"and {report.more_troubles} more" if report.more_troubles else ""
    return Table(
        f"{report.name}: faults and what followed", ("mission time", "fault", "what followed"), rows, note
    )


def _later(event: Told, fault: Told) -> str:
    return f"+{(event.at_ms - fault.at_ms) / 1000:.0f} s"


def clock(at_ms: int) -> str:
    """`1:02:03` of mission time."""
    seconds = at_ms // 1000
    return f"{seconds // 3600}:{seconds // 60 % 60:02}:{seconds % 60:02}"


def _html_table(table: Table) -> str:
    head = "".join(f"<th>{escape(it)}</th>" for it in table.columns)
    rows = "".join("<tr>" + "".join(f"<td>{escape(it)}</td>" for it in row) + "</tr>" for row in table.rows)
    note = f"<p>{escape(table.note)}</p>" if table.note else ""
    body = f"<table><tr>{head}</tr>{rows}</table>" if table.rows else ""
    return f"<h2>{escape(table.title)}</h2>{body}{note}"


def _html_figure(figure: Any) -> str:
    picture = io.BytesIO()
    figure.savefig(picture, format="png", dpi=110)
    return f'<img src="data:image/png;base64,{base64.b64encode(picture.getvalue()).decode()}" alt="">'


def _write_pdf(parts: Sequence[Part], path: Path, title: str) -> None:
    from matplotlib.backends.backend_pdf import PdfPages

    temporary = path.with_name(f".{path.name}.new")
    try:
        with PdfPages(temporary, metadata={"Title": title, "CreationDate": None}) as pages:
            for part in parts:
                if isinstance(part, Table):
                    for first in range(0, max(1, len(part.rows)), _ROWS_A_PAGE):
                        pages.savefig(_table_page(part, part.rows[first : first + _ROWS_A_PAGE]))
                else:
                    pages.savefig(part)
        temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)


def _table_page(table: Table, rows: Sequence[Sequence[str]]) -> Any:
    from matplotlib.figure import Figure

    wide = len(table.columns) > 8 or any(len(it) > 60 for row in rows for it in row)
    figure = Figure(figsize=(14 if wide else 9, 0.9 + 0.24 * (len(rows) + 1)))
    axes = figure.add_axes((0.02, 0.02, 0.96, 0.9))
    axes.axis("off")
    axes.set_title(table.title, loc="left", fontsize=11)
    if rows:
        cut = [[it if len(it) <= 90 else f"{it[:89]}…" for it in row] for row in rows]
        drawn = axes.table(
            cut, colLabels=list(table.columns), loc="upper left", cellLoc="left", edges="horizontal"
        )
        drawn.auto_set_font_size(False)
        drawn.set_fontsize(7)
        drawn.auto_set_column_width(list(range(len(table.columns))))
    if table.note:
        figure.text(0.02, 0.01, table.note, fontsize=7)
    return figure


_PAGE = """<!doctype html>
<html lang="en"><head><meta charset="utf-8"><title>{title}</title>
<style>body {{font: 15px/1.4 sans-serif; margin: 2em; max-width: 80em}} table {{border-collapse: collapse; font-size: 13px}}
td, th {{padding: .2em .6em; text-align: left; border-bottom: 1px solid #ccc}} img {{max-width: 100%; display: block}}
</style></head>
<body>
<h1>{title}</h1>
{body}
</body></html>
"""
