"""A run's row of the paper's Table II, beside the paper's own."""

from __future__ import annotations

from typing import Any

from rich.padding import Padding
from rich.text import Text

from apad_bridge.assembly.capacity_bounds import Bounds
from apad_bridge.records.summary import interruption
from apad_bridge.runs.rich_console import Console, table_of
from apad_bridge.scenario.paper_rows import row_of

_MOST_CAUSES = 5


def print_table(
    console: Console,
    name: str,
    collection: str,
    summary: dict[str, Any],
    bounds: Bounds | None = None,
    *,
    has_faults: bool = False,
) -> None:
    """Prints the row, the paper's row if it compares, the other figures, the bounds of any strategy, and the failures.

    `has_faults` is true where the scenario injects faults: the paper's flights had none.
    """
    why_none = interruption(summary)
    is_row = why_none is None and not has_faults
    title = "a row of the paper's Table II" if is_row else "no row of the paper's Table II"
    table = table_of(f"{name}: {title}", ("", "Avg %", "Max %", "Min %", "Cost [m]", "Active"))
    if summary["uptime_paper"] is not None:
        table.add_row(f"{collection} (this run)", *_figures(summary))
    for apad, apad_summary in summary.get("apads", {}).items():
        if apad_summary["uptime_paper"] is not None:
            table.add_row(f"{apad}, {apad_summary['agents']} aMussels", *_figures(apad_summary), style="dim")
    if (
        table.row_count > 0
        and (paper := row_of(name, collection)) is not None
        and _is_as_shipped(summary)
        and is_row
    ):
        table.add_row(f"{collection} (paper)", *(f"{it:.2f}" for it in paper.figures), style="dim")
    if table.row_count > 0:
        console.print(table)
    if why_none is not None:
        _print(console, f"Interrupted: {why_none}. Do not compare its figures with those of a whole flight.")
    dead = f", {summary['gave_up']} dead for good" if summary["gave_up"] else ""
    _print(
        console,
        f"{summary['services']} served, {_count_text(summary['amussels_lost'])} lost, {_count_text(summary['emptied'])} "
        f"emptied{dead}. End of the mission: {summary['ended_by']}.",
    )
    _print(
        console,
        f"Way planned: {summary['planned_m']:.2f} m in straight legs, as the paper counts. "
        f"Way flown: {summary['cost_m']:.2f} m.",
    )
    if (equal := summary.get("uptime_equal_charge")) is not None:
        _print(
            console,
            f"Charge at the end minus at the begin: {summary['charge_gain_mean']:+.3f} of a battery. "
            f"Uptime at equal charge: {equal:.2f} %.",
        )
    _print(console, f"{_energy(summary)}.")
    if summary["samples_uploaded"] is not None:
        _print(
            console,
            f"Samples: {_count_text(summary['samples_taken'])} taken, {summary['samples_uploaded']} uploaded, "
            f"{_count_text(summary['samples_waiting'])} still aboard, {summary['samples_lost']} lost.",
        )
    if table.row_count > 0 and bounds is not None:
        _print(console, bounds.text)
    if (apart := summary["excluded"]) is not None:
        _print(
            console,
            f"Excluded ({apart['amussels']} aMussel{'' if apart['amussels'] == 1 else 's'}): "
            f"{apart['beside_real_s']:g} s shadowing a real one, {apart['retired_s']:g} s retired.",
        )
    _print_failures(console, summary)


def _print_failures(console: Console, summary: dict[str, Any]) -> None:
    """Prints the causes of failures, the most frequent first, and the aMussels that they cost."""
    causes = sorted(summary["causes"].items(), key=lambda it: -it[1])
    if causes:
        _print(console, f"Failures ({summary['steps_given_up']} steps given up):")
    for cause, count in causes[:_MOST_CAUSES]:
        _print(console, f"{count} x {cause}", indent=2)
    if len(causes) > _MOST_CAUSES:
        _print(console, f"{len(causes) - _MOST_CAUSES} more causes: see summary.json", indent=2)
    if failed_docks := summary["failed_docks"]:
        numbers = ", ".join(str(dock_index + 1) for dock_index in failed_docks)
        _print(
            console, f"Each docking failed in dock {numbers}: the bounds above are those of the other docks."
        )
    if summary["left_alone"]:
        ids = ", ".join(map(str, summary["left_alone"]))
        _print(console, f"Left alone after failed tries: aMussel {ids}")
    if beyond := summary["beyond_reach"]:
        _print(console, f"Beyond reach at the end: aMussel {', '.join(map(str, beyond))}")


def _print(console: Console, text: str, indent: int = 0) -> None:
    """Prints a line, folded between words to a terminal's width; a file or a pipe gets it as one line."""
    if console.is_terminal:
        console.print(Padding(Text(text), (0, 0, 0, indent), expand=False))
    else:
        console.print(" " * indent + text, highlight=False, soft_wrap=True)


def _is_as_shipped(summary: dict[str, Any]) -> bool:
    """True for a whole flight of the pool with its own fleet, time scale and seed, with which the paper's row compares."""
    own = {
        "theta": 30,
        "seed": 1,
        "agents": 12,
        "mission_s": 2400.0,
        "excluded": None,
        "ended_by": "mission time",
    }
    return all(summary[key] == value for key, value in own.items())


def _figures(summary: dict[str, Any]) -> list[str]:
    uptime = summary["uptime_paper"]
    spread = [f"{uptime[key]:.2f}" for key in ("mean", "max", "min")]
    return [*spread, f"{summary['planned_m']:.2f}", f"{summary['active_mean']:.2f}"]


def _energy(summary: dict[str, Any]) -> str:
    if (fraction := summary["apad_energy_fraction"]) is None:
        return f"No figure of the aPad's energy ({summary['apad_energy_missing']})"
    return f"The aPad used {100 * fraction:.1f} % of its battery"


def _count_text(count: int | None) -> str:
    return "unknown" if count is None else str(count)
