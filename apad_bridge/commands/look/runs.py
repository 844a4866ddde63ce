"""`musselbed runs`: the runs of a folder with their key figures, newest first."""

from __future__ import annotations

import argparse
import json
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from rich import box
from rich.console import Console
from rich.table import Table

from apad_bridge.commands.help_text import ending
from apad_bridge.records.run_directory import RUNS, RunDirectory
from apad_bridge.runs.children import supervisor_of
from apad_bridge.runs.exits import Exit, UserError

FLIES = "flies"
DID_NOT_END = "did not end"
_COLUMNS_OF_FIGURES = 58
"""Columns of a screen for a run's figures and the gaps beside them."""
_LEAST = 16


@dataclass(frozen=True, slots=True)
class Row:
    """A run. Figures are None until it has ended; uptime in percent, as the paper counts it."""

    run: str
    begun: str
    """UTC, ISO 8601."""
    state: str
    """Why it ended, that it flies, or that it did not end."""
    agents: int | None = None
    mission_s: float | None = None
    uptime: float | None = None
    planned_m: float | None = None
    services: int | None = None
    lost: int | None = None
    stopped_s: float | None = None
    """Mission time in which a person or a guard kept the mission from the aPad; None in a summary of an older version."""


def add_parser(commands: Any) -> None:
    parser = commands.add_parser(
        "runs",
        description="Lists the runs of a folder: the begin of each, the cause of its end, and its figures.",
        epilog=ending("musselbed runs", "musselbed runs /data/adriatic --json"),
    )
    parser.add_argument(
        "folder",
        type=Path,
        nargs="?",
        default=RUNS,
        metavar="DIR",
        help=f"the folder of the runs (default: {RUNS}/)",
    )
    parser.add_argument("--json", action="store_true", help="print the runs as a JSON list on stdout")
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    if not arguments.folder.is_dir():
        raise UserError(f"{arguments.folder}: no such folder: fly a scenario first, or name another folder")
    rows = rows_of(arguments.folder)
    if arguments.json:
        print(json.dumps([asdict(row) for row in rows]))
    elif not rows:
        print(f"no runs in {arguments.folder}")
    else:
        console = Console(markup=False)
        console.print(_table(rows, console.width))
    return Exit.DONE


def rows_of(folder: Path) -> list[Row]:
    """The runs in this folder, newest first."""
    directories = [RunDirectory(path) for path in folder.iterdir() if (path / "scenario.yaml").is_file()]
    return sorted(map(_row, directories), key=lambda row: (row.begun, row.run), reverse=True)


def _row(directory: RunDirectory) -> Row:
    begun = (
        datetime.fromtimestamp(directory.versions.stat().st_mtime, UTC)
        if directory.versions.is_file()
        else None
    )
    named = directory.path.name, "" if begun is None else f"{begun:%Y-%m-%dT%H:%M:%SZ}"
    try:
        summary = json.loads(directory.summary.read_text(encoding="utf-8"))
        return Row(
            *named,
            summary["ended_by"],
            summary["agents"],
            summary["mission_s"],
            None if summary["uptime_paper"] is None else round(summary["uptime_paper"]["mean"], 2),
            round(summary["planned_m"], 2),
            summary["services"],
            summary["amussels_lost"],
            summary.get("stopped_s"),
        )
    except FileNotFoundError:
        members = [directory.path, *(it.parent for it in directory.path.glob("*/scenario.yaml"))]
        flies = any(supervisor_of(member) is not None for member in members)
        return Row(*named, FLIES if flies else DID_NOT_END)
    except (OSError, ValueError, KeyError, TypeError) as error:
        return Row(*named, f"summary.json cannot be read: {error}")


def _table(rows: list[Row], width: int) -> Table:
    """One line a run: of a long error as much as a screen of this width has room for."""
    room = width - max(len(row.run) for row in rows) - _COLUMNS_OF_FIGURES
    table = Table(box=box.SIMPLE_HEAD)
    table.add_column("run", no_wrap=True, overflow="ignore")  # people copy it
    table.add_column("ended by", no_wrap=True, overflow="ellipsis", max_width=max(_LEAST, room))
    for name in ("agents", "minutes", "uptime %", "m", "services", "lost"):
        table.add_column(name, justify="right")
    for row in rows:
        minutes = None if row.mission_s is None else row.mission_s / 60
        table.add_row(
            row.run,
            row.state if not row.stopped_s else f"stopped for {row.stopped_s / 60:.0f} min; {row.state}",
            *(_text(it, ".0f") for it in (row.agents, minutes)),
            _text(row.uptime, ".2f"),
            _text(row.planned_m, ".0f"),
            *(_text(it, ".0f") for it in (row.services, row.lost)),
        )
    return table


def _text(number: float | None, form: str) -> str:
    return "" if number is None else format(number, form)
