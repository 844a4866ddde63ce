"""Prints the outcome of a run, or the plan of a dry run, for a person or as JSON."""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from shlex import quote
from typing import Any

from rich.console import Console

from apad_bridge.commands.table import print_table
from apad_bridge.mission.ending import EndReason
from apad_bridge.records.run_directory import RunDirectory
from apad_bridge.runs.exits import Exit, exit_of_all
from apad_bridge.runs.studies.capacity import bounds_of
from apad_bridge.scenario.loader import load


def report(
    name: str,
    flown_by: str,
    directory: RunDirectory,
    summary: dict[str, Any],
    as_json: bool,
    messages: Sequence[str] = (),
) -> int:
    """Prints a run's outcome; returns the exit code. `flown_by` names the strategy, or another source of commands.

    A person saw the `messages` during the flight; the JSON has them beside the summary, as `events`.
    """
    if as_json:
        print(json.dumps({**summary, "run": str(directory.path), "events": list(messages)}))
    else:
        console = Console(markup=False)
        is_counted = summary["uptime_paper"] is not None
        bounds = bounds_of([load(directory.scenario)], summary["mission_s"]) if is_counted else None
        print_table(console, name, flown_by, summary, bounds)
        _print_next(console, directory, summary)
    sys.stdout.flush()
    # With several aPads, each one's reason.
    reasons = [EndReason(each["end_reason"]) for each in summary.get("apads", {"": summary}).values()]
    if EndReason.FLEET_LOST in reasons:
        print(f"musselbed: {summary['ended_by']}; see {directory.path}", file=sys.stderr)
    if EndReason.SCRIPT_FAILED in reasons:
        print(f"musselbed script: {summary['ended_by']}", file=sys.stderr)
    return exit_of_all(reasons)


def _print_next(console: Console, directory: RunDirectory, summary: dict[str, Any]) -> None:
    """Prints the place of the files, and two commands to copy, which no terminal folds."""
    # The records of several aPads lie in a directory for each.
    of_one = directory.path / next(iter(summary.get("apads", {"": None})))
    has_truth = summary["uptime_paper"] is not None
    second = f"beliefs {quote(str(of_one))}" if has_truth else f"runs {quote(str(directory.path.parent))}"
    lines = (
        f"Files: {directory.path}",
        "Next:",
        f"  musselbed replay {quote(str(of_one))}",
        f"  musselbed {second}",
    )
    for line in lines:
        console.print(line, highlight=False, soft_wrap=True)


def print_plan(plan: dict[str, Any] | None, as_json: bool) -> int:
    """Prints the plan of a dry run."""
    if as_json:
        print(json.dumps(plan))
    elif plan is None:
        print("no plan: there are never enough candidates")
    else:
        steps = ", ".join(f"aMussel {step['agent']} into dock {step['dock'] + 1}" for step in plan["steps"])
        costs = plan["costs"]
        print(f"at {plan['t'] / 1000:.0f} s, {plan['strategy']}: {steps}")
        print(
            f"distance {costs['distance_m']:.1f} m, demand {costs['demand']:.2f} batteries; nothing was commanded"
        )
    return Exit.DONE
