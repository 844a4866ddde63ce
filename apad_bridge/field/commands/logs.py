"""`musselbed logs merge A.bag B.bag`: bags of one mission that were recorded on two machines."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from rich.table import Table

from apad_bridge.commands.help_text import ending
from apad_bridge.field.bag_merge.bag_figures import RunFigures
from apad_bridge.field.bag_merge.merge import Merge, merge
from apad_bridge.runs.progress import WorkProgress
from apad_bridge.runs.rich_console import Console, print_result
from apad_bridge.scenario.errors import UserError

_MOST_GAPS = 20


_ENDING = ending(
    "musselbed logs merge apad.bag station.bag",
    "musselbed logs merge apad.bag station.bag --out whole.bag --json",
)


def add_parser(commands: Any) -> None:
    parser = commands.add_parser("logs", epilog=_ENDING)
    actions = parser.add_subparsers(dest="action", metavar="ACTION", required=True)
    merging = actions.add_parser(
        "merge",
        help="merge two bags, and list the gaps of each",
        description="Finds the messages that two bags have in common, and from them the offset of their clocks as a "
        "function of time, also where one of them was set meanwhile. Lists the gaps of each bag, and writes one bag "
        "with all messages by the clock of A. Counts the run's figures from either bag alone and from both.",
        epilog=_ENDING,
    )
    merging.add_argument("first", type=Path, metavar="A.bag", help="the bag whose clock counts")
    merging.add_argument("second", type=Path, metavar="B.bag", help="the other machine's bag")
    merging.add_argument(
        "--out",
        type=Path,
        metavar="FILE",
        help="the merged bag, a new file (default: beside A, A-merged.bag)",
    )
    merging.add_argument("--json", action="store_true", help="print a JSON object")


def run(arguments: argparse.Namespace) -> int:
    first, second = arguments.first, arguments.second
    out = arguments.out or first.with_name(f"{first.stem}-merged.bag")
    if out.exists():
        raise UserError(f"{out} exists already: name a new file with --out")
    with WorkProgress(arguments.json) as progress:
        progress.step(f"merging {first} and {second}")
        merged = merge(first, second, out)
    return print_result(
        arguments.json,
        {"out": str(out), **merged.to_json()},
        lambda: _show(merged, out, Console(highlight=False)),
    )


def _show(merged: Merge, out: Path, console: Console) -> None:
    matching = merged.matching
    for stretch in matching.offset.stretches:
        console.print(
            f"B's clock is {stretch.offset_s:+.3f} s from A's, drifting {1e6 * stretch.drift:+.1f} us/s "
            f"({stretch.messages} common messages, {1000 * stretch.spread_s:.1f} ms from that)"
        )
    for step_s in matching.offset.steps_s:
        console.print(f"a clock was set: the offset changed by {step_s:+.3f} s")
    table = Table("topic", "in A", "in B", "in both", "missing in A", "missing in B")
    for it in merged.topics:
        row = (it.first, it.second, it.both, it.missing_in_first, it.missing_in_second)
        table.add_row(it.topic, *map(str, row))
    console.print(table)
    for gap in merged.gaps[:_MOST_GAPS]:
        where, other = ("A", "B") if gap.in_first else ("B", "A")
        span = f"{gap.to_s - gap.from_s:.1f} s from {gap.from_s:.1f} s on"
        console.print(f"{where} has nothing for {span}, {other} has {gap.messages} messages")
    if len(merged.gaps) > _MOST_GAPS:
        console.print(f"and {len(merged.gaps) - _MOST_GAPS} gaps more: --json has them all")
    _show_figures(merged, console)
    console.print(f"{merged.merged_messages} messages in {out}", soft_wrap=True)


def _show_figures(merged: Merge, console: Console) -> None:
    figures = {
        "A": merged.figures_of_first,
        "B": merged.figures_of_second,
        "merged": merged.figures_of_merged,
    }
    if not any(figures.values()):
        console.print("no run's figures: neither bag has musselbed's own topics")
        return
    table = Table("from", "by", "uptime %", "max %", "min %", "cost [m]", "served", "ticks", "lacking")
    for name, it in figures.items():
        if it is not None:
            table.add_row(name, *_cells(it))
    console.print(table)


def _cells(figures: RunFigures) -> tuple[str, ...]:
    uptimes = (figures.uptime_paper_mean, figures.uptime_paper_max, figures.uptime_paper_min)
    return (
        figures.samples or "-",
        *("-" if it is None else f"{it:.2f}" for it in (*uptimes, figures.cost_m)),
        *map(str, (figures.services, figures.ticks, figures.ticks_missing)),
    )
