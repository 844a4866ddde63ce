"""`musselbed branch RUN --at TIME`: fly a run again from a moment on with other rules, or without an aPad."""

from __future__ import annotations

import argparse
import sys
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from apad_bridge.commands.help_text import MISSION_TIME, STRATEGY, ending, mission_seconds
from apad_bridge.commands.trust import add_trust_argument, trust_of_run
from apad_bridge.runs.progress import WorkProgress
from apad_bridge.runs.rich_console import Console, print_result, table_of
from apad_bridge.scenario.errors import UserError
from apad_bridge.scenario.text.yaml_text import parse_yaml

if TYPE_CHECKING:
    from apad_bridge.studies.branching import Branches


def add_parser(commands: Any) -> None:
    parser = commands.add_parser(
        "branch",
        description="Repeats a run up to a moment, from its stimuli or from its records, and goes on in virtual time with "
        "other rules. Prints the figures beside those of a branch that changes nothing. The run's records do not change.",
        epilog=ending(
            "musselbed branch runs/pool-12-1 --at 14:20 --strategy greedy",
            "musselbed branch runs/pool-12-1 --at 860 --set pool_threshold=0.5 --set charge_to=0.8 --json",
            "musselbed branch runs/bay-120-1 --at 1:00:00 --lose-apad apad2",
            note="See docs/recipes.md.",
        ),
    )
    parser.add_argument("directory", type=Path, metavar="RUN", help="the run's directory")
    parser.add_argument(
        "--at",
        required=True,
        type=mission_seconds,
        metavar="T",
        help=f"the moment: {MISSION_TIME}",
    )
    parser.add_argument("--strategy", metavar=STRATEGY, help="another collection strategy")
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="KEY=VALUE",
        help="another value of a key of `mission`, as pool_threshold=0.5; repeatable",
    )
    parser.add_argument("--lose-apad", metavar="NAME", help="this aPad does nothing from then on")
    add_trust_argument(parser)
    parser.add_argument("--json", action="store_true", help="print the figures as JSON on stdout")


def run(arguments: argparse.Namespace) -> int:
    # Imported here: a branch needs all parts of a flight.
    from apad_bridge.records.run_directory import RunDirectory
    from apad_bridge.studies.branching import Turn, branch

    rules = dict(_rule(text) for text in arguments.set)
    if arguments.strategy is not None:
        rules["collection"] = arguments.strategy
    if not rules and arguments.lose_apad is None:
        raise UserError("nothing changes: give --strategy, --set or --lose-apad")
    with WorkProgress(arguments.json) as progress:
        progress.step(f"flying {arguments.directory} again, unchanged and changed")
        turn = Turn(round(arguments.at * 1000), rules, arguments.lose_apad)
        typed = [str(rules[it]) for it in ("collection", "redeployment") if it in rules]
        trust = trust_of_run(arguments, RunDirectory(arguments.directory), *typed)
        branches = branch(arguments.directory, turn, trust)
    if branches.has_our_firmware:
        print("a branch flies our firmware in place of fleet.firmware", file=sys.stderr)
    return print_result(
        arguments.json,
        asdict(branches),
        lambda: _show(branches, arguments.at, Console(markup=False, highlight=False)),
    )


def _rule(text: str) -> tuple[str, Any]:
    key, equals, value = text.partition("=")
    try:
        if equals:
            return key, parse_yaml(value)
    except ValueError as error:
        raise UserError(f"--set {text}: {error}") from error
    raise UserError(f"--set {text}: use KEY=VALUE, as pool_threshold=0.5")


def _show(branches: Branches, at_s: float, console: Console) -> None:
    from apad_bridge.studies.branching import FIGURES

    headings = ("", "as flown", "unchanged", "changed", "difference")
    table = table_of(f"changed at {at_s:g} s of mission time", headings, title_justify="left")
    for key, name in FIGURES.items():
        flown, unchanged, changed = (it[key] for it in (branches.flown, branches.unchanged, branches.changed))
        difference = None if unchanged is None or changed is None else changed - unchanged
        table.add_row(name, _text(flown), _text(unchanged), _text(changed), _text(difference, "+"))
    console.print(table)
    if not branches.is_exact:
        console.print(
            "Both branches go on from the run's records, with a simulated aPad: compare them with each other alone.",
            soft_wrap=True,
        )


def _text(value: float | None, sign: str = "") -> str:
    if value is None:
        return "–"
    return f"{value:{sign}d}" if isinstance(value, int) else f"{value:{sign}.2f}"
