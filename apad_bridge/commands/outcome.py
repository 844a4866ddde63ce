"""Prints the outcome of a run, or the plan of a dry run, for a person or as JSON, and decides the exit code of a run."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path
from shlex import quote
from typing import Any, assert_never

from agents.time_scale import MissionMs
from apad_bridge.assembly.capacity_bounds import bounds_of
from apad_bridge.commands.table_two_row import print_table
from apad_bridge.events.mission_events import PlanMade
from apad_bridge.events.run_events import EndReason
from apad_bridge.records.journal import Entry
from apad_bridge.records.run_directory import RunDirectory
from apad_bridge.runs.exits import Exit
from apad_bridge.runs.rich_console import Console
from apad_bridge.scenario.schema import Scenario
from apad_bridge.scenario.timed_faults import Faults


def report(
    scenario: Scenario,
    flown_by: str,
    directory: RunDirectory,
    summary: dict[str, Any],
    as_json: bool,
    messages: Sequence[str] = (),
    bags: Sequence[Path] = (),
    *,
    is_virtual: bool = False,
) -> int:
    """Prints a run's outcome; returns the exit code. `flown_by` names the strategy, or another source of commands.

    A person saw the `messages` during the flight; the JSON has them beside the summary, as `events`. `bags` are all that
    stays of the run; without them its directory does. A flight in virtual time (`is_virtual`) has a digest that another
    machine's flight repeats.
    """
    if as_json:
        files = {"bags": [str(it) for it in bags]} if bags else {"run": str(directory.path)}
        print(json.dumps({**summary, **files, "events": list(messages)}))
    else:
        console = Console(markup=False)
        is_counted = summary["uptime_paper"] is not None
        failed = len(summary["failed_docks"])
        bounds = bounds_of([scenario], summary["mission_s"], failed) if is_counted else None
        print_table(
            console,
            scenario.name,
            flown_by,
            summary,
            bounds,
            has_faults=scenario.faults not in (None, Faults()),
        )
        if is_virtual:
            line = f"Digest of decisions and happenings: {summary['digest']}   (the same on every machine)"
            console.print(line, highlight=False, soft_wrap=True)
        if bags:
            files_line = f"Files: {', '.join(map(str, bags))}   (all of the run: --out DIR)"
            console.print(files_line, highlight=False, soft_wrap=True)
        else:
            _print_next(console, directory, summary)
    sys.stdout.flush()
    reasons = [EndReason(each["end_reason"]) for each in summary.get("apads", {"": summary}).values()]
    if _LOSSES & set(reasons):
        print(f"musselbed: {summary['ended_by']}; see {directory.path}", file=sys.stderr)
    if EndReason.SCRIPT_FAILED in reasons:
        print(f"musselbed script: {summary['ended_by']}", file=sys.stderr)
    return exit_of_all(reasons)


_LOSSES = {EndReason.FLEET_LOST, EndReason.SEA_LOST, EndReason.CLOCK_LOST, EndReason.NODE_ENDED}


def exit_of(reason: EndReason) -> Exit:
    """The exit code of a run whose mission ended for this reason."""
    match reason:
        case (
            EndReason.MISSION_TIME
            | EndReason.APAD_BATTERY
            | EndReason.END_BY
            | EndReason.CALL
            | EndReason.FIRST_PLAN
            | EndReason.SCRIPT_ENDED
            | EndReason.SCRIPT_ABORTED
        ):
            return Exit.DONE
        case EndReason.OPERATOR:
            return Exit.INTERRUPTED
        case (
            EndReason.SCRIPT_FAILED
            | EndReason.STRATEGY_FAILED
            | EndReason.FLEET_LOST
            | EndReason.SEA_LOST
            | EndReason.CLOCK_LOST
            | EndReason.NODE_ENDED
            | EndReason.DISK_FULL
            | EndReason.RECORDS_GONE
        ):
            return Exit.PEER_FAILED
        case _:
            assert_never(reason)


def exit_of_all(reasons: Iterable[EndReason]) -> Exit:
    """The exit code of several aPads' missions: a failure of one comes before Ctrl-C, and Ctrl-C before the rest."""
    codes = {exit_of(reason) for reason in reasons}
    return next((it for it in (Exit.PEER_FAILED, Exit.INTERRUPTED) if it in codes), Exit.DONE)


def _print_next(console: Console, directory: RunDirectory, summary: dict[str, Any]) -> None:
    """Prints the place of the files, and two commands to copy, which no terminal folds."""
    # The records of several aPads lie in a directory for each.
    of_one = directory.path / next(iter(summary.get("apads", {"": None})))
    has_truth = summary["uptime_paper"] is not None
    second = f"beliefs {quote(str(of_one))}" if has_truth else f"runs {quote(str(directory.path.parent))}"
    lines = (
        f"Files: {directory.path}",
        "Next:",
        f"  musselbed replay {quote(str(directory.path))}",
        f"  musselbed {second}",
    )
    for line in lines:
        console.print(line, highlight=False, soft_wrap=True)


def plan_line(made: tuple[MissionMs, PlanMade] | None) -> dict[str, Any] | None:
    """The journal's line of a plan."""
    return None if made is None else Entry(*made).line


def print_plan(made: tuple[MissionMs, PlanMade] | None, as_json: bool) -> int:
    """Prints the plan of a dry run, with its mission time."""
    if as_json:
        print(json.dumps(plan_line(made)))
    elif made is None:
        print("no plan: there are never enough candidates")
    else:
        at_ms, plan = made
        steps = ", ".join(f"aMussel {step['agent']} into dock {step['dock'] + 1}" for step in plan.steps)
        costs = plan.costs
        print(f"at {at_ms / 1000:.0f} s, {plan.strategy}: {steps}")
        print(
            f"distance {costs['distance_m']:.1f} m, demand {costs['demand']:.2f} batteries; no order was given"
        )
    return Exit.DONE
