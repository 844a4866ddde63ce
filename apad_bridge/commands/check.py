"""`musselbed check RUN`: the laws that hold in every run, on a run's records."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any, TextIO

from apad_bridge.commands.help_text import ending
from apad_bridge.runs.exits import Exit, UserError
from apad_bridge.scenario.errors import ScenarioError

if TYPE_CHECKING:
    from apad_bridge.analysis.invariants import Broken

MOST_SHOWN = 10
"""Broken laws that a person sees of one aPad's run; `--json` has them all."""


def add_parser(commands: Any) -> None:
    parser = commands.add_parser(
        "check",
        description="Checks the journal and the samples of a run. Time never falls, and energy is neither made nor "
        "lost. An aMussel is in one dock and at one place. Samples are kept once, beliefs are finite, and the cost is the "
        "way driven. A broken law is a defect of musselbed; the command prints the lines that show it.",
        epilog=ending("musselbed check runs/NAME", "musselbed check runs/* --json"),
    )
    parser.add_argument("directories", type=Path, nargs="+", metavar="RUN", help="a run's directory")
    parser.add_argument("--json", action="store_true", help="print the broken laws as JSON, by directory")
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    broken: dict[Path, list[Broken]] = {}
    for directory in arguments.directories:
        broken |= broken_laws(directory)
    if arguments.json:
        print(json.dumps({str(path): [asdict(it) for it in each] for path, each in broken.items()}))
    else:
        print_laws(broken, sys.stdout)
    return exit_of_laws(broken)


def exit_of_laws(broken: Mapping[Path, list[Broken]]) -> int:
    return Exit.BUG if any(broken.values()) else Exit.DONE


def broken_laws(directory: Path) -> dict[Path, list[Broken]]:
    """The broken laws by the directory of each aPad's run. UserError for a directory without a run, or a damaged one."""
    from apad_bridge.analysis.invariants import check_run
    from apad_bridge.records.run_directory import RunDirectory, RunDirectoryError

    found = [
        it.parent
        for it in (directory / "journal.jsonl", *sorted(directory.glob("*/journal.jsonl")))
        if it.exists()
    ]
    if not found:
        raise UserError(f"{directory}: no journal.jsonl is there: name the directory of a run")
    try:
        return {each: check_run(RunDirectory.open(each)) for each in found}
    except (RunDirectoryError, ScenarioError, OSError) as error:
        raise UserError(str(error)) from error


def print_laws(broken: Mapping[Path, list[Broken]], to: TextIO) -> None:
    """Prints for a person whether the laws hold, and the lines that break them."""
    for path, each in broken.items():
        print(f"{path}: {f'broken laws: {len(each)}' if each else 'all laws hold'}", file=to)
        for it in each[:MOST_SHOWN]:
            print(
                f"  {it.law}: {it.reason}",
                *(f"    {json.dumps(line)}" for line in it.lines),
                sep="\n",
                file=to,
            )
