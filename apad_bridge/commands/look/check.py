"""`musselbed check RUN`: the rules that hold in every run, on a run's records; and the first difference of two runs."""

from __future__ import annotations

import argparse
import json
import sys
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, TextIO

from apad_bridge.commands.help_text import ending
from apad_bridge.runs.exits import Exit
from apad_bridge.runs.progress import WorkProgress
from apad_bridge.runs.rich_console import print_result
from apad_bridge.scenario.errors import UserError

if TYPE_CHECKING:
    from apad_bridge.analysis.invariants import Broken
    from apad_bridge.records.digest import CountedEvent

MOST_SHOWN = 10
"""Broken rules that a person sees of one aPad's run; `--json` has them all."""


def add_parser(commands: Any) -> None:
    parser = commands.add_parser(
        "check",
        description="Checks the journal and the samples of a run. Time never falls, and energy is neither made nor "
        "lost. An aMussel is in one dock and at one place. Samples are kept once, beliefs are finite, and the cost is the "
        "way driven. A broken rule is a defect of musselbed; the command prints the lines that show it. With --digest it "
        "compares one run with another instead, perhaps from another machine: by all that was decided and happened, and by "
        "nothing that belongs to the machine.",
        epilog=ending(
            "musselbed check runs/NAME",
            "musselbed check runs/* --json",
            "musselbed check runs/NAME --digest runs/OTHER",
        ),
    )
    parser.add_argument("directories", type=Path, nargs="+", metavar="RUN", help="a run's directory")
    parser.add_argument(
        "--digest",
        type=Path,
        metavar="OTHER_RUN",
        help="name the first event in which RUN differs from this run; exit code 1 if there is one",
    )
    parser.add_argument("--json", action="store_true", help="print the broken rules as JSON, by directory")


def run(arguments: argparse.Namespace) -> int:
    if arguments.digest is not None:
        if len(arguments.directories) != 1:
            raise UserError("--digest compares one run with another: name one RUN")
        return _compare(arguments.directories[0], arguments.digest, as_json=arguments.json)
    broken: dict[Path, list[Broken]] = {}
    with WorkProgress(arguments.json) as progress:
        for directory in arguments.directories:
            progress.step(f"checking {directory}")
            broken |= broken_rules(directory)
    print_result(
        arguments.json,
        {
            str(path): [
                {"rule": it.rule, "reason": it.reason, "lines": [entry.line for entry in it.entries]}
                for it in each
            ]
            for path, each in broken.items()
        },
        lambda: print_rules(broken, sys.stdout),
    )
    return exit_of_rules(broken)


def exit_of_rules(broken: Mapping[Path, list[Broken]]) -> int:
    return Exit.BUG if any(broken.values()) else Exit.DONE


def _compare(one: Path, other: Path, *, as_json: bool) -> int:
    """Prints the digests of two runs, and the first event in which they differ."""
    from apad_bridge.records.digest import combined_digest, counted_events
    from apad_bridge.records.journal import read_journal

    digests, events = [], []
    for directory in (one, other):
        # With several aPads, each one's own: an event is told by its aPad too.
        each = [
            (it.relative_to(directory), *counted_events(read_journal(it / "journal.jsonl").entries))
            for it in _runs_in(directory)
        ]
        digests.append(combined_digest(digest for _, _, digest in each))
        events.append([(event, str(path)) for path, found, _ in each for event in found])
    differing = first_difference(*events)
    if as_json:
        print(json.dumps({"digests": digests, "differing": differing}))
    else:
        print(
            *(f"{digest}  {directory}" for digest, directory in zip(digests, (one, other), strict=True)),
            sep="\n",
        )
        if differing is None:
            print("the same decisions and happenings")
        else:
            print("the first event that differs:")
            print(
                *(f"  {directory}: {text}" for directory, text in zip((one, other), differing, strict=True)),
                sep="\n",
            )
    return Exit.DONE if differing is None else Exit.BUG


def first_difference(
    one: Sequence[tuple[CountedEvent, str]], other: Sequence[tuple[CountedEvent, str]]
) -> tuple[str, str] | None:
    """The first event of each that the other does not have, each with its aPad; None for equal runs."""
    counts = Counter(one)
    counts.subtract(other)
    if not (lacking := sorted(it for it, count in counts.items() if count)):
        return None
    first = [next((it for it in lacking if counts[it] * sign > 0), None) for sign in (1, -1)]
    ours, theirs = (
        f"{'' if it[1] == '.' else it[1] + ', '}{it[0]}" if it is not None else "none" for it in first
    )
    return ours, theirs


def _runs_in(directory: Path) -> list[Path]:
    """The directory of each aPad's run; the directory itself where none has a journal."""
    found = [
        it.parent
        for it in (directory / "journal.jsonl", *sorted(directory.glob("*/journal.jsonl")))
        if it.exists()
    ]
    return found or [directory]


def broken_rules(directory: Path) -> dict[Path, list[Broken]]:
    """The broken rules by the directory of each aPad's run. RunDirectoryError for no run, or a damaged one."""
    from apad_bridge.analysis.invariants import check_run
    from apad_bridge.records.run_directory import RunDirectory

    return {each: check_run(RunDirectory.open(each)) for each in _runs_in(directory)}


def print_rules(broken: Mapping[Path, list[Broken]], to: TextIO) -> None:
    """Prints for a person whether the rules hold, and the lines that break them."""
    for path, each in broken.items():
        print(f"{path}: {f'broken rules: {len(each)}' if each else 'all rules hold'}", file=to)
        for it in each[:MOST_SHOWN]:
            print(
                f"  {it.rule}: {it.reason}",
                *(f"    {json.dumps(entry.line)}" for entry in it.entries),
                sep="\n",
                file=to,
            )
