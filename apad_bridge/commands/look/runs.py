"""`musselbed runs`: the runs of a folder with their key figures, newest first."""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from pathlib import Path
from shutil import get_terminal_size
from typing import Any

from apad_bridge.commands.help_text import ending
from apad_bridge.records.run_directory import RUNS, RunDirectory
from apad_bridge.runs.exits import Exit
from apad_bridge.runs.supervisor_lock import supervisor_of
from apad_bridge.scenario.errors import UserError

FLIES = "flies"
DID_NOT_END = "did not end"
_ENDED_BY = "ended by"
_FIGURES = ("agents", "minutes", "uptime %", "m", "services", "lost")
_LEAST = 16
"""Characters of a cause of the end that are shown at least."""


@dataclass(frozen=True, slots=True)
class RunRow:
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


def run(arguments: argparse.Namespace) -> int:
    if not arguments.folder.is_dir():
        raise UserError(f"{arguments.folder}: no such folder: fly a scenario first, or name another folder")
    rows = rows_of(arguments.folder)
    if arguments.json:
        print(json.dumps([asdict(row) for row in rows]))
    elif not rows:
        print(f"no runs in {arguments.folder}")
    else:
        print("\n".join(lines_of(rows, get_terminal_size().columns)))
    return Exit.DONE


def rows_of(folder: Path) -> list[RunRow]:
    """The runs in this folder, newest first."""
    directories = [RunDirectory(path) for path in folder.iterdir() if (path / "scenario.yaml").is_file()]
    return sorted(map(_row, directories), key=lambda row: (row.begun, row.run), reverse=True)


def _row(directory: RunDirectory) -> RunRow:
    begun = (
        datetime.fromtimestamp(directory.versions.stat().st_mtime, UTC)
        if directory.versions.is_file()
        else None
    )
    named = directory.path.name, "" if begun is None else f"{begun:%Y-%m-%dT%H:%M:%SZ}"
    try:
        summary = json.loads(directory.summary.read_text(encoding="utf-8"))
        return RunRow(
            *named,
            state=summary["ended_by"],
            agents=summary["agents"],
            mission_s=summary["mission_s"],
            uptime=None if summary["uptime_paper"] is None else round(summary["uptime_paper"]["mean"], 2),
            planned_m=round(summary["planned_m"], 2),
            services=summary["services"],
            lost=summary["amussels_lost"],
            stopped_s=summary.get("stopped_s"),
        )
    except FileNotFoundError:
        members = [directory.path, *(it.parent for it in directory.path.glob("*/scenario.yaml"))]
        flies = any(supervisor_of(member) is not None for member in members)
        return RunRow(*named, FLIES if flies else DID_NOT_END)
    except (OSError, ValueError, KeyError, TypeError) as error:
        return RunRow(*named, f"summary.json cannot be read: {error}")


def lines_of(rows: list[RunRow], width: int) -> list[str]:
    """The rows for a screen of this width, with no name and no figure cut: one line a run, or two where one is too narrow.

    The cause of a run's end gets the room that is left.
    """
    figures = [_figures(row) for row in rows]
    columns = [max(map(len, column)) for column in zip(_FIGURES, *figures, strict=True)]
    names = max(len(row.run) for row in rows)
    room = width - names - 2 - sum(it + 2 for it in columns)
    if room < _LEAST:
        lines = [f"run  {_ENDED_BY}", _numbers(_FIGURES, columns)]
        for row, its in zip(rows, figures, strict=True):
            lines += [f"{row.run}  {_cut(_end(row), width - len(row.run) - 2)}", _numbers(its, columns)]
        return [line.rstrip() for line in lines]
    ends = [_ENDED_BY, *(_cut(_end(row), room) for row in rows)]
    longest = max(map(len, ends))
    return [
        f"{name:<{names}}  {end:<{longest}}{_numbers(its, columns)}".rstrip()
        for name, end, its in zip(
            ["run", *(row.run for row in rows)], ends, [_FIGURES, *figures], strict=True
        )
    ]


def _end(row: RunRow) -> str:
    return row.state if not row.stopped_s else f"stopped for {row.stopped_s / 60:.0f} min; {row.state}"


def _figures(row: RunRow) -> tuple[str, ...]:
    minutes = None if row.mission_s is None else row.mission_s / 60
    return (
        *(_text(it, ".0f") for it in (row.agents, minutes)),
        _text(row.uptime, ".2f"),
        _text(row.planned_m, ".0f"),
        *(_text(it, ".0f") for it in (row.services, row.lost)),
    )


def _numbers(texts: Sequence[str], columns: Sequence[int]) -> str:
    return "".join(f"{text:>{column + 2}}" for text, column in zip(texts, columns, strict=True))


def _cut(text: str, room: int) -> str:
    room = max(room, _LEAST)
    return text if len(text) <= room else text[: room - 1] + "…"


def _text(number: float | None, form: str) -> str:
    return "" if number is None else format(number, form)
