"""The figures of a report: the paper's 5, 6 and 9 drawn from a run's data, and its energy. Matplotlib's, for any format."""

from __future__ import annotations

import io
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

from agents.time_scale import TimeScale
from apad_bridge.analysis.energy.energy import AgentEnergy, summed
from apad_bridge.analysis.report.contents import RunReport
from firmware_model.power.charge import FULL, Battery, ChargeModel, Flow, fraction, grains

_MS_PER_MINUTE = 60_000
_MODEL, _DATA = "#1f4e79", "#c77d0a"
_LONGEST_MS = 48 * 3_600_000
"""Agent time: no course of a battery is drawn longer."""


WIDTH_INCHES = 7.1
"""The width of an A4 page within its margins."""
BELIEFS_INCHES = (WIDTH_INCHES, 5.6)
"""The figure of the beliefs, which shares a page with their table."""
_MAP_INCHES = 4.9
"""The greatest height of the map, which shares a page with the batteries."""
_SMALL = 8
"""Points: the least text, on paper and on a phone."""
_LEGEND_ROW_INCHES = 0.19
_DARK = (
    "<style>@media (prefers-color-scheme: dark) { svg { filter: invert(.92) hue-rotate(180deg); } }</style>"
)


def _figure(height: float) -> Any:
    from matplotlib.figure import Figure

    return Figure(figsize=(WIDTH_INCHES, height), layout="constrained")


def as_file(figure: Any, made_by: str) -> str:
    """The figure as an SVG file of its own: dark where its reader's page is, and with the command that made it."""
    text = io.StringIO()
    figure.savefig(text, format="svg", metadata={"Date": None, "Creator": f"made by {made_by}"})
    return text.getvalue().replace("<defs>", f"{_DARK}<defs>", 1)


def activity(reports: Sequence[RunReport]) -> Any:
    """The paper's Fig. 9: the number of active aMussels, a line for each run."""
    figure = _figure(3.2)
    axes = figure.subplots()
    for later, report in reversed(list(enumerate(reversed(reports)))):
        if report.data["has_truth"]:
            minutes = [ms / _MS_PER_MINUTE for ms in report.data["times_ms"]]
            # Of lines at the same height each shows its edges below the next one.
            width = 1.2 + 0.8 * min(later, 3)
            (line,) = axes.step(
                minutes, report.data["active"], where="post", linewidth=width, label=report.name
            )
            for begin_ms, end_ms in report.stopped_ms:
                span = begin_ms / _MS_PER_MINUTE, end_ms / _MS_PER_MINUTE
                axes.axvspan(*span, color=line.get_color(), alpha=0.15, linewidth=0)
    axes.set(xlabel="mission time (min)", ylabel="active aMussels")
    axes.set_ylim(bottom=0)
    axes.grid(alpha=0.3)
    if axes.lines:
        axes.legend(fontsize=_SMALL)
    return figure


def places(report: RunReport) -> Any:
    """The paper's Fig. 6: where the aMussels began, in their area, and the aPad's way."""
    data = report.data
    figure = _figure(_MAP_INCHES)
    axes = figure.subplots()
    norths, easts = zip(*[*data["polygon"], data["polygon"][0]], strict=True)
    axes.fill(easts, norths, facecolor="#d9ecf7", edgecolor="#7fb2d3", linewidth=1.2)
    for line in data["chart"]:
        norths, easts = zip(*line["points"], strict=True)
        axes.plot(easts, norths, color="#7fb2d3", linewidth=2 if line["depth"] is None else 0.7)
    for zone in [data["fence"], *data["keep_out"]] if data["fence"] else []:
        norths, easts = zip(*[*zone, zone[0]], strict=True)
        axes.plot(easts, norths, "--", color="#b0303a", linewidth=1)
    if data["trace"]:
        _, norths, easts = zip(*data["trace"], strict=True)
        axes.plot(easts, norths, color=_MODEL, alpha=0.35, linewidth=0.8)
    for agent_id, (north, east) in data["homes"].items():
        axes.plot(east, north, "o", color="#2b9a57", markersize=6)
        axes.annotate(
            str(agent_id), (east, north), xytext=(5, 4), textcoords="offset points", fontsize=_SMALL
        )
    axes.set_aspect("equal")
    axes.set(xlabel="east (m)", ylabel="north (m)")
    return figure


def batteries(report: RunReport) -> Any | None:
    """The paper's Fig. 5: the primary batteries' courses against the model, each begun at its own charge on the curve.

    Whole boards discharge by what they do, so their model is drawn where it charges alone. A flow of which the run has no
    course is left out; None for a run without any.
    """
    courses = {flow: list(_courses(report, flow)) for flow in (Flow.DISCHARGING, Flow.CHARGING)}
    if not (there := [flow for flow, some in courses.items() if some]):
        return None
    figure = _figure(3.2)
    model = report.charge_model
    for axes, flow in zip(figure.subplots(1, len(there), squeeze=False)[0], there, strict=True):
        whole = Battery(0, FULL if flow is Flow.DISCHARGING else 0, flow)
        has_model = flow is Flow.CHARGING or model.discharge > 0
        if has_model:
            times_ms = range(0, _end_ms(model, whole) + 1, _MS_PER_MINUTE)
            curve = [fraction(model.charge_at(whole, ms)) for ms in times_ms]
            axes.plot([ms / _MS_PER_MINUTE for ms in times_ms], curve, color=_MODEL, linewidth=1.2)
        for course in courses[flow]:
            first_ms = _meets(model, whole, course[0][1]) if has_model else 0
            minutes = [(first_ms + ms - course[0][0]) / _MS_PER_MINUTE for ms, _ in course]
            axes.plot(
                minutes,
                [charge for _, charge in course],
                ".",
                color=_DATA,
                alpha=0.5,
                markersize=4,
                rasterized=True,
            )
        name = "discharging" if flow is Flow.DISCHARGING else "charging"
        axes.set(xlabel="agent time (min)", ylabel="charge", ylim=(0, 1.02), title=name)
        axes.grid(alpha=0.3)
    return figure


def _end_ms(model: ChargeModel, battery: Battery) -> int:
    ends = model.empty_at_ms(battery) if battery.charge else model.reaches_at_ms(battery, FULL)
    return min(_LONGEST_MS, ends or _LONGEST_MS)


def _meets(model: ChargeModel, battery: Battery, charge: float) -> int:
    """When the model's course comes to this charge."""
    find = model.falls_to_at_ms if battery.flow is Flow.DISCHARGING else model.reaches_at_ms
    return find(battery, grains(charge)) or 0


def _courses(report: RunReport, flow: Flow) -> Iterator[list[tuple[int, float]]]:
    """The spans of (agent ms, charge) in which an aMussel's samples fall, or rise."""
    data = report.data
    scale = TimeScale(data["theta"])
    times_ms = [scale.agent_ms(ms) for ms in data["times_ms"]]
    for agent in data["agents"]:
        course: list[tuple[int, float]] = []
        for ms, charge in zip(times_ms, agent["charge"], strict=True):
            known = charge is not None
            if known and course and (charge - course[-1][1]) * (1 if flow is Flow.CHARGING else -1) <= 0:
                yield from [course] if len(course) > 2 else []
                course = []
            if known:
                course.append((ms, charge))
        yield from [course] if len(course) > 2 else []


def energy(report: RunReport) -> Any:
    """Energy that each aMussel drew, in percent of a battery: by module, and by state."""
    from matplotlib import colormaps

    columns: dict[str, Callable[[AgentEnergy], Mapping[str, float]]] = {
        "by module": lambda it: it.by_module,
        "by state": lambda it: it.by_state,
    }
    names = [list(summed(report.energy, of)) for of in columns.values()]
    figure = _figure(3.0 + _LEGEND_ROW_INCHES * -(-max(map(len, names)) // 2))
    for part, own, (title, of) in zip(figure.subfigures(1, 2), names, columns.items(), strict=True):
        axes = part.subplots()
        places_, bottom = range(len(report.energy)), [0.0] * len(report.energy)
        for name, colour in zip(own, map(colormaps["tab20"], range(20)), strict=False):
            drawn = [100 * of(it).get(name, 0.0) for it in report.energy]
            axes.bar(places_, drawn, bottom=bottom, width=0.8, color=colour, label=name.replace("_", " "))
            bottom = [below + it for below, it in zip(bottom, drawn, strict=True)]
        few = len(report.energy) <= 40
        axes.set_xticks(
            places_ if few else [],
            [it.agent_id for it in report.energy] if few else [],
            fontsize=_SMALL,
            rotation=90,
        )
        axes.set(xlabel="aMussel", ylabel="% of a battery", title=title)
        if axes.containers:
            part.legend(fontsize=_SMALL, ncols=2, loc="outside lower center")
    return figure
