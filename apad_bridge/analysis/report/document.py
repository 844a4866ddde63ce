"""Writes a report of one run or several: one HTML page, which a browser prints on A4. It needs no other file."""

from __future__ import annotations

import base64
import io
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from html import escape
from importlib.resources import files
from math import fsum
from pathlib import Path
from typing import Any, NamedTuple

from apad_bridge.analysis.belief_scores import score_figure as belief_figure
from apad_bridge.analysis.belief_scores.scores import Score
from apad_bridge.analysis.energy.energy import AgentEnergy, summed
from apad_bridge.analysis.report import report_figures
from apad_bridge.analysis.report.contents import RunReport
from apad_bridge.scenario.text.text_file import write_atomically

PAGE = "report.html"
_RUNS_SIDE_BY_SIDE = 4
"""Runs that one table has on a page's width; more have further tables."""
_DRAWN = 0.0005
"""The least error of a charge that a figure can show beside the tables."""
_SHORT = 20
"""A table of so many rows stays on one page."""
_ROWS = (
    *("strategies", "theta", "seed", "aMussels"),
    *("uptime, average %", "uptime, greatest %", "uptime, least %", "active, average"),
    *("uptime at equal charge %", "charge, end - begin"),
    *("way planned m", "way flown m"),
    *("served", "emptied", "lost", "given up", "ended by"),
)


class Table(NamedTuple):
    title: str
    columns: Sequence[str]
    rows: Sequence[Sequence[str]]
    note: str = ""


@dataclass(frozen=True, slots=True)
class Picture:
    figure: Any
    """A figure of matplotlib."""
    caption: str


Part = Table | Picture


def write_report(reports: Sequence[RunReport], folder: Path) -> Path:
    """Writes `report.html` and returns its path. OSError."""
    folder.mkdir(parents=True, exist_ok=True)
    names = ", ".join(report.name for report in reports)
    sections = [("The runs", list(_compared(reports)))]
    sections += [(report.name, list(_parts(report))) for report in reports]
    number = 0
    body: list[str] = []
    for title, parts in sections:
        body.append(f"<section><h2>{escape(title)}</h2>")
        for part in parts:
            if isinstance(part, Table):
                body.append(_html_table(part))
            else:
                number += 1
                body.append(_html_figure(part, number))
        body.append("</section>")
    style = (files("apad_bridge.analysis.report") / "report.css").read_text(encoding="utf-8")
    about = "".join(f"<p>{escape(it)}</p>" for it in map(_about, reports))
    page = _PAGE.format(title=escape(f"Report: {names}"), style=style, about=about, body="\n".join(body))
    write_atomically(folder / PAGE, page)
    return folder / PAGE


def _about(report: RunReport) -> str:
    """The run's scenario, its date and the software that flew it, in one line."""
    commit = report.versions.get("commit")
    software = f"musselbed {report.versions.get('musselbed') or 'of an unknown version'}"
    return (
        f"{report.name}: scenario {report.data['name']}, flown on {report.flown_on}, {software}"
        f"{f', commit {commit}' if commit else ''}"
    )


def _compared(reports: Sequence[RunReport]) -> Iterator[Part]:
    columns = list(map(_figures_of, reports))
    for first in range(0, len(reports), _RUNS_SIDE_BY_SIDE):
        some = slice(first, first + _RUNS_SIDE_BY_SIDE)
        yield Table(
            "Figures",
            ["", *(it.name for it in reports[some])],
            [[name, *(it[n] for it in columns[some])] for n, name in enumerate(_ROWS)],
            "Uptime as the paper counts it; at equal charge, with what is left over or missing at the end valued at the "
            "boards' own rates. Way planned: the straight legs that were ordered, as the paper counts its "
            "cost. Way flown: by the aPad's reported positions. The figures of a run that was stopped are those "
            "of no whole flight; its stops are shaded.",
        )
    if any(report.data["has_truth"] for report in reports):
        yield Picture(report_figures.activity(reports), "Number of active aMussels, as the paper's Fig. 9.")


def _parts(report: RunReport) -> Iterator[Part]:
    yield Picture(
        report_figures.places(report), "Where the aMussels began, as the paper's Fig. 6, and the way flown."
    )
    if (batteries := report_figures.batteries(report)) is not None:
        yield Picture(
            batteries,
            "Primary batteries, as the paper's Fig. 5. Line, where there is one: the model; points: the run, agent time.",
        )
    if any(fsum(it.by_module.values()) > 0 for it in report.energy):
        yield Picture(
            report_figures.energy(report), "Energy that each aMussel drew, in percent of a battery."
        )
        yield _energy_table(report, "module", lambda it: it.by_module)
        yield _energy_table(report, "state", lambda it: it.by_state)
    if report.why_no_energy is not None:
        yield Table("Energy by module", ("module",), [], f"It is left out: {report.why_no_energy}")
    if report.scores is not None:
        yield _belief_table(report)
        if report.scores.overall.rmse > _DRAWN:  # perfect knowledge has nothing to draw
            yield Picture(
                belief_figure.figure_of(report.scores, "", report_figures.BELIEFS_INCHES),
                "Beliefs: the error of the charge, and the share of true charges in the interval of 95 %; dashed: 0.95.",
            )
    yield _trouble_table(report)


def _figures_of(report: RunReport) -> list[str]:
    """The run's column of the first table, in the order of `_ROWS`."""
    data, known = report.data, report.summary or {}
    uptime = known.get("uptime_paper") or {}
    ended = data["ended_by"] or "has not ended"
    return [
        f"{data['collection']} / {data['redeployment']}",
        *(f"{data[key]}" for key in ("theta", "seed")),
        str(len(data["agents"])),
        *(_number(uptime.get(key), ".2f") for key in ("mean", "max", "min")),
        *(_number(known.get(key), ".2f") for key in ("active_mean", "uptime_equal_charge")),
        _number(known.get("charge_gain_mean"), "+.3f"),
        *(_number(known.get(key), ".2f") for key in ("planned_m", "cost_m")),
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
    return Table(f"Energy by {by}", (by, "% of a battery, mean", "share %"), rows, note)


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
    why = report.why_scored_by_journal
    note = "" if why is None else f"By the journal: {why}."
    return Table("Believed charge minus true charge", columns, rows, note)


def _score_row(name: str, score: Score) -> list[str]:
    return [
        name,
        str(score.samples),
        f"{score.rmse:.4f}",
        f"{score.bias:+z.4f}",
        _number(score.coverage, ".3f"),
        f"{score.mode_right:.3f}",
        _number(score.place_rmse_m, ".2f"),
    ]


def _trouble_table(report: RunReport) -> Table:
    rows = [
        (
            clock(fault.at_ms),
            fault.text,
            "; ".join(f"+{(it.at_ms - fault.at_ms) / 1000:.0f} s {it.text}" for it in followed),
        )
        for fault, followed in report.troubles
    ]
    note = "None." if not rows else f"and {report.more_troubles} more" if report.more_troubles else ""
    return Table("Faults and what followed", ("mission time", "fault", "what followed"), rows, note)


def clock(at_ms: int) -> str:
    """`1:02:03` of mission time."""
    seconds = at_ms // 1000
    return f"{seconds // 3600}:{seconds // 60 % 60:02}:{seconds % 60:02}"


def _html_table(table: Table) -> str:
    head = "".join(f"<th>{escape(it)}</th>" for it in table.columns)
    rows = "".join("<tr>" + "".join(f"<td>{escape(it)}</td>" for it in row) + "</tr>" for row in table.rows)
    note = f"<p class=note>{escape(table.note)}</p>" if table.note else ""
    kind = "wide short" if len(table.rows) <= _SHORT else "wide"
    body = (
        f"<div class='{kind}'><table><thead><tr>{head}</tr></thead><tbody>{rows}</tbody></table></div>"
        if rows
        else ""
    )
    return f"<h3>{escape(table.title)}</h3>{body}{note}"


def _html_figure(picture: Picture, number: int) -> str:
    """An <img> of its own document, because several drawings in one page would share the names of their parts."""
    import matplotlib as mpl

    drawn = io.BytesIO()
    with mpl.rc_context({"svg.hashsalt": "musselbed", "savefig.dpi": 150}):
        picture.figure.savefig(drawn, format="svg", metadata={"Date": None})
    caption = escape(picture.caption)
    source = base64.b64encode(drawn.getvalue()).decode()
    return (
        f'<figure><div class=wide><img src="data:image/svg+xml;base64,{source}" alt="{caption}"></div>'
        f"<figcaption>Figure {number}. {caption}</figcaption></figure>"
    )


_PAGE = """<!doctype html>
<html lang="en"><head><meta charset="utf-8"><meta name="viewport" content="width=device-width, initial-scale=1">
<title>{title}</title>
<style>{style}</style></head>
<body>
<header><h1>{title}</h1>
{about}</header>
{body}
</body></html>
"""
