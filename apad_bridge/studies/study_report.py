"""A study's results: `results.parquet` with a row for each mission, and `report.html` with tables and figures.

Only this module needs the packages of `musselbed[studies]`, and imports them when it writes.
"""

from __future__ import annotations

import io
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

from apad_bridge.assembly.capacity_bounds import Bounds, bounds_of
from apad_bridge.scenario.text.text_file import replacing, write_atomically
from apad_bridge.studies.mission_figures import COLUMNS
from apad_bridge.studies.runner import Row
from apad_bridge.studies.specification import Setting, StudyPlan
from apad_bridge.studies.statistics import Difference, Estimate, Standing, standings

if TYPE_CHECKING:
    from matplotlib.figure import Figure

RESULTS, REPORT = "results.parquet", "report.html"
HEADINGS = {
    "amussels_lost": "lost",
    "samples_taken": "samples taken",
    "longest_gap_h": "longest gap h",
    "uptime_submerged_mean": "submerged %",
    "uptime_submerged_min": "submerged %, least",
    "uptime_paper_mean": "uptime %",
    "uptime_paper_min": "uptime %, least",
    "uptime_equal_charge": "uptime % at equal charge",
    "charge_gain_mean": "charge, end - begin",
    "metres": "way planned m",
    "metres_per_service": "m/service",
    "apad_wh": "aPad Wh",
    "apad_cycles": "aPad cycles",
    "dead_time_h": "dead h",
    "final_charge_mean": "final charge",
}
"""The rows of a table of strategies, in their order, as people read them: one name for one figure."""
_BETWEEN_COLUMNS = 3
_PAGE_WIDTH = 116
"""Characters beside the names of the figures, on the page as wide as its style lets it be."""
NO_ENERGY = "aPad Wh and aPad cycles stand at theta 1 alone: at any other an aMussel charges faster than the aPad spends"


@dataclass(frozen=True, slots=True)
class Comparison:
    """One setting's strategies, best first, and what nobody can exceed there."""

    setting: Setting
    standings: list[Standing]
    bounds: Bounds


def comparisons(plan: StudyPlan, rows: Sequence[Row]) -> list[Comparison]:
    """Compares the strategies of each setting; settings do not compare with each other."""
    study = plan.study
    return [
        Comparison(
            setting,
            standings(
                [row for row in rows if row["setting"] == index],
                plan.strategies,
                plan.baseline,
                study.primary,
                study.confidence,
            ),
            bounds_of([plan.scenario(index, 0, seed) for seed in plan.seeds]),
        )
        for index, setting in enumerate(plan.settings)
    ]


def verdict(found: Comparison, plan: StudyPlan) -> str:
    """Which strategies lie above and below the baseline in the primary figure, where their intervals leave out 0."""
    sides: dict[str, list[str]] = {"above it": [], "below it": [], "not clearly different": []}
    for each in found.standings:
        if difference := each.differences.get(plan.study.primary):
            low, high = difference.estimate.low, difference.estimate.high
            side = "above it" if low > 0 else "below it" if high < 0 else "not clearly different"
            sides[side].append(f"{each.strategy} {difference_text(difference)}")
    known = [f"{side}: {', '.join(names)}" for side, names in sides.items() if names]
    against = (
        f"{HEADINGS[plan.study.primary]}, against {plan.baseline}: {'; '.join(known)}. " if known else ""
    )
    first = found.standings[0].strategy
    return f"{against}First by aMussels lost, then samples, then way: {first}."


def as_data(plan: StudyPlan, found: Sequence[Comparison]) -> dict[str, Any]:
    """The comparisons as plain data for `--json`; NaN becomes None."""
    return {
        "study": plan.study.name,
        "model": plan.study.model.value,
        "missions": plan.missions,
        "seeds": len(plan.seeds),
        "baseline": plan.baseline,
        "primary": plan.study.primary,
        "confidence": plan.study.confidence,
        "settings": [
            {
                "setting": each.setting.label,
                "bounds": asdict(each.bounds),
                "ranking": [standing.strategy for standing in each.standings],
                "strategies": [_known(asdict(standing)) for standing in each.standings],
            }
            for each in found
        ],
    }


def _known(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _known(inner) for key, inner in value.items()}
    return None if isinstance(value, float) and math.isnan(value) else value


def write_parquet(path: Path, plan: StudyPlan, rows: Sequence[Row]) -> None:
    """Writes a row for each mission: setting, parameters, draws, strategy, seed, figures; whole or not at all."""
    import pyarrow
    from pyarrow import parquet

    table = pyarrow.Table.from_pylist([_record(plan, row) for row in rows])
    with replacing(path) as fresh:
        parquet.write_table(table, fresh)


def _record(plan: StudyPlan, row: Row) -> dict[str, Any]:
    setting = plan.settings[row["setting"]]
    decided = {**dict(setting.parameters), **plan.drawn(row["seed"])}
    parameters = {
        key: str(value) if isinstance(value, list | dict) else value for key, value in decided.items()
    }
    head = {"scenario": setting.scenario, "theta": setting.theta, **parameters}
    return {**head, **{key: value for key, value in row.items() if key != "setting"}}


def write_report(
    path: Path,
    plan: StudyPlan,
    rows: Sequence[Row],
    found: Sequence[Comparison],
    answer: Sequence[str] = (),
    over_parameter: Figure | None = None,
) -> None:
    """Writes one page that needs no other file; it begins with the study's own answer and figure, if it has them."""
    study = plan.study
    parts = [
        f"<h1>{escape(study.name)}</h1>",
        *(f"<pre>{escape(it)}</pre>" if "\n" in it else f"<p>{escape(it)}</p>" for it in answer),
        f"<p>{plan.missions} missions on {len(plan.seeds)} configurations, flown by the model "
        f"<em>{escape(study.model)}</em>. Means with intervals of {100 * study.confidence:g} %. The order is by aMussels "
        f"lost, then samples taken, then way planned. Differences are to <em>{escape(plan.baseline)}</em>, paired by "
        f"configuration; the primary figure is {escape(HEADINGS[study.primary])}, all other p-values are adjusted by "
        "Holm.</p>",
        *([] if over_parameter is None else [f"<div class=sweep>{_svg(over_parameter)}</div>"]),
    ]
    for index, each in enumerate(found):
        parts += [
            f"<h2>{escape(each.setting.label)}</h2>",
            f"<p><b>{escape(verdict(each, plan))}</b></p>",
            f"<p>{escape(each.bounds.text)}</p>",
            "<div class=pair>",
            _table("Means", each.standings, lambda it, column: estimate_text(it.columns[column])),
        ]
        if others := [it for it in each.standings if it.differences]:
            heading = f"Minus {plan.baseline}"
            parts.append(_table(heading, others, lambda it, column: difference_text(it.differences[column])))
        parts.append("</div>")
        if each.setting.theta != 1:
            parts.append(f"<p>{NO_ENERGY}.</p>")
        drawn = _figures([row for row in rows if row["setting"] == index], plan, each.bounds)
        parts.append(f"<div class=figures>{''.join(map(_svg, drawn))}</div>")
    write_atomically(path, _PAGE.format(title=escape(study.name), body="\n".join(parts)))


_PAGE = """<!doctype html>
<html lang="en"><head><meta charset="utf-8"><meta name="viewport" content="width=device-width, initial-scale=1">
<title>{title}</title>
<style>body {{font: 15px/1.4 sans-serif; margin: 0 auto; padding: 1.5em; max-width: 1200px; box-sizing: border-box}}
@page {{size: A4 landscape; margin: 12mm}} @media print {{body {{padding: 0; font-size: 9pt}}}}
h2, h3 {{break-after: avoid}} .wide {{overflow-x: auto}} table {{border-collapse: collapse; break-inside: avoid}}
table + table {{margin-top: 1.5em}}
td, th {{padding: .2em .8em .2em 0; text-align: right; white-space: nowrap; border-bottom: 1px solid #8888}}
td:first-child, th:first-child {{text-align: left}}
svg {{flex: 1 1 300px; width: 100%; max-width: 560px; height: auto; background: #fff; break-inside: avoid}}
.sweep {{overflow-x: auto}} .sweep svg {{min-width: 560px; max-width: 720px}}
.pair {{display: flex; flex-wrap: wrap; gap: 0 3em}}
.figures {{display: flex; flex-wrap: wrap; gap: 1em; align-items: start}}
@media (max-width: 720px) {{
  td, th {{font-size: 12px; padding-right: .5em; white-space: normal}}
  h3::after {{content: " (swipe for all columns)"; font-weight: normal; font-size: .8em}}}}
@media screen and (prefers-color-scheme: dark) {{:root {{color-scheme: dark}} body {{background: #12171d; color: #e6ebf1}}
  svg {{filter: invert(.92) hue-rotate(180deg)}}}} /* drawings are white: dark here, with their own hues */
</style></head>
<body>
{body}
</body></html>
"""


def _table(heading: str, found: Sequence[Standing], text: Callable[[Standing, str], str]) -> str:
    """A row for each figure and a column for each strategy, the best first; below each other if a page is too narrow."""
    cells = {it.strategy: [text(it, column) for column in COLUMNS] for it in found}

    def row(tag: str, texts: Sequence[str]) -> str:
        return "<tr>" + "".join(f"<{tag}>{escape(it)}</{tag}>" for it in texts) + "</tr>"

    tables = []
    for names in that_fit(cells, _PAGE_WIDTH):
        head = row("th", ["", *names])
        body = [
            row("td", [HEADINGS[it], *(cells[name][n] for name in names)]) for n, it in enumerate(COLUMNS)
        ]
        tables.append(f"<table>{head}{''.join(body)}</table>")
    return f"<div class=wide><h3>{escape(heading)}</h3>{''.join(tables)}</div>"


def that_fit(cells: dict[str, list[str]], width: int) -> Iterator[list[str]]:
    """The strategies in groups whose columns fit beside each other, in their order."""
    group: list[str] = []
    used = 0
    for name, texts in cells.items():
        wanted = max(map(len, [name, *texts])) + _BETWEEN_COLUMNS
        if group and used + wanted > width:
            yield group
            group, used = [], 0
        group, used = [*group, name], used + wanted
    if group:
        yield group


def estimate_text(estimate: Estimate | None) -> str:
    """`71.87 ± 0.42`; a dash for an unknown figure."""
    if estimate is None:
        return "–"
    half = (estimate.high - estimate.low) / 2
    return _number(estimate.mean) if math.isnan(half) else f"{_number(estimate.mean)} ± {_number(half)}"


def difference_text(difference: Difference | None) -> str:
    """`+1.20 ± 0.42, p 0.003`; a dash for an unknown figure."""
    if difference is None:
        return "–"
    sign = "" if estimate_text(difference.estimate).startswith("-") else "+"
    p = (
        ""
        if math.isnan(difference.p)
        else f" (p {difference.p:.3f})"
        if difference.p >= 0.001
        else " (p < 0.001)"
    )
    return f"{sign}{estimate_text(difference.estimate)}{p}"


def _number(value: float) -> str:
    digits = 0 if abs(value) >= 1000 else 1 if abs(value) >= 100 else 2
    return f"{value:z.{digits}f}"


def _figures(rows: Sequence[Row], plan: StudyPlan, bounds: Bounds) -> Iterator[Figure]:
    """Box plots of the primary figure and of those that rank, and the way against the uptime."""
    import matplotlib

    matplotlib.use("svg")
    from matplotlib.figure import Figure

    by_strategy = [[row for row in rows if row["strategy"] == name] for name in plan.strategies]
    for column in dict.fromkeys((plan.study.primary, "samples_taken", "uptime_submerged_mean")):
        drawing = Figure(figsize=(4.2, 4), layout="constrained")
        axis = drawing.subplots()
        known = [[row[column] for row in own if row[column] is not None] for own in by_strategy]
        axis.boxplot(known, tick_labels=list(plan.strategies))
        axis.set_ylabel(HEADINGS[column])
        for label in axis.get_xticklabels():  # side by side at this slope, so many names do not overlap
            label.set(rotation=35, horizontalalignment="right", rotation_mode="anchor")
        if column == "uptime_submerged_mean":
            axis.axhline(bounds.uptime_percent, linestyle="--", color="dimgrey", label="no strategy exceeds")
            drawing.legend(loc="outside upper right", frameon=False)
        yield drawing
    drawing = Figure(figsize=(4.2, 4 + 0.22 * -(-len(by_strategy) // 2)), layout="constrained")
    axis = drawing.subplots()
    for number, (name, own) in enumerate(zip(plan.strategies, by_strategy, strict=True)):
        x, y = ([row[column] for row in own] for column in ("metres", "uptime_paper_mean"))
        # Rings of their own sizes: two strategies often fly the same mission.
        axis.scatter(x, y, s=12 * (number + 1), label=name, facecolors="none", edgecolors=f"C{number}")
    axis.set(xlabel=HEADINGS["metres"], ylabel=HEADINGS["uptime_paper_mean"])
    drawing.legend(loc="outside lower center", ncols=2)  # beside the missions, of which it would hide some
    yield drawing


def _svg(drawing: Figure) -> str:
    text = io.StringIO()
    drawing.savefig(text, format="svg", metadata={"Date": None})
    svg = text.getvalue()
    return svg[svg.index("<svg") :]
