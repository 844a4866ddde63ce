"""`musselbed explain RUN`: why a plan was made: its candidates, what was believed of them, its costs and its runner-up."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from apad_bridge.commands.help_text import MISSION_TIME, ending, mission_seconds
from apad_bridge.events.mission_events import PlanMade
from apad_bridge.planning.registry import rule_of
from apad_bridge.records.journal import Entry, read_journal
from apad_bridge.records.run_directory import RunDirectory
from apad_bridge.runs.progress import WorkProgress
from apad_bridge.runs.rich_console import Console, print_result, table_of
from apad_bridge.scenario.errors import UserError
from firmware_model.packets import QUANTITIES


def add_parser(commands: Any) -> None:
    parser = commands.add_parser(
        "explain",
        description="Prints the plan in force at a mission time: its candidates with their beliefs, the cost of each "
        "part, and the other plans that the strategy weighed, the runner-up first. Reads the journal, "
        "also of a run that is still flying.",
        epilog=ending(
            "musselbed explain runs/pool-12-20260504T101500Z --at 10:00",
            "musselbed explain runs/pool-12-20260504T101500Z --json",
            note="See docs/recipes.md.",
        ),
    )
    parser.add_argument("directory", type=Path, metavar="RUN", help="the run's directory")
    parser.add_argument(
        "--at",
        type=mission_seconds,
        metavar="T",
        help=f"{MISSION_TIME} (default: the end, which shows the newest plan)",
    )
    parser.add_argument("--json", action="store_true", help="print the journal's line of the plan")


def run(arguments: argparse.Namespace) -> int:
    with WorkProgress(arguments.json) as progress:
        progress.step(f"reading {arguments.directory}")
        journal = read_journal(RunDirectory.open(arguments.directory).journal)
    if not (plans := list(journal.events(PlanMade))):
        raise UserError(f"{arguments.directory}: no plan was made yet")
    if arguments.at is not None and 1000 * arguments.at > journal.last_ms:
        raise UserError(f"--at {arguments.at:g}: the run has come to {journal.last_ms / 1000:g} s")
    made = [it for it in plans if arguments.at is None or it[0] <= arguments.at * 1000]
    if not made:
        raise UserError(f"--at {arguments.at:g}: the first plan was made at {plans[0][0] / 1000:g} s")
    at_ms, plan = made[-1]
    return print_result(arguments.json, Entry(at_ms, plan).line, lambda: _show(at_ms, plan, Console()))


def _show(at_ms: int, plan: PlanMade, console: Console) -> None:
    chosen = [step["agent"] for step in plan.steps]
    what = "to collect" if plan.what == "collect" else "to release"
    console.print(f"{at_ms / 1000:g} s: {plan.strategy} planned {what} {_ids(chosen)}", highlight=False)
    if rule := rule_of(plan.strategy):
        console.print(f"the rule of {plan.strategy}: {rule}", highlight=False)
    if plan.exchanged is not None:
        pairs = [f"{it['released']} takes the place of {it['collected']}" for it in plan.exchanged]
        console.print(f"on the same tour {', '.join(pairs)}", highlight=False)
    costs = plan.costs
    console.print(
        f"{costs['distance_m']:.1f} m of way and {costs['demand']:.2f} batteries of demand; scaled by the scenario "
        f"{costs['distance_cost']:.1f} and {costs['energy_cost']:.1f}",
        highlight=False,
    )
    headings = (
        "aMussel",
        "place in the plan",
        "charge",
        "second battery",
        "unserved s",
        "north m",
        "east m",
        *(f"{it.text} {it.unit}".strip() for it in QUANTITIES.values()),
    )
    table = table_of("The candidates, as they were believed", headings, title_justify="left")
    for belief in plan.beliefs:
        reported = belief.get("reported", {})
        table.add_row(
            str(belief["id"]),
            str(chosen.index(belief["id"]) + 1) if belief["id"] in chosen else "",
            f"{belief['charge']:.3f}",
            f"{belief['secondary']:.3f}" if "secondary" in belief else "",
            f"{belief['unserved_s']:.0f}" if "unserved_s" in belief else "",
            f"{belief['north_m']:.2f}",
            f"{belief['east_m']:.2f}",
            *(f"{reported[name]:.2f}" if name in reported else "" for name in QUANTITIES),
        )
    console.print(table)
    _show_options(plan, console)


def _show_options(plan: PlanMade, console: Console) -> None:
    if not (options := plan.options):
        why = plan.unexplained
        console.print(
            "no reasons given" + (f": its explanation failed: {why}" if why else ""),
            highlight=False,
            markup=False,
        )
        return
    names = list(options[0]["parts"])
    table = table_of(
        "The plans that were weighed, by the strategy's own cost: the least is the best",
        ("", "aMussels", "cost", *names),
        left=("", "aMussels"),
        title_justify="left",
    )
    for rank, option in enumerate(options):
        parts = [f"{option['parts'].get(name, 0.0):.3f}" for name in names]
        rank_name = ("the plan", "runner-up")[rank] if rank < 2 else ""
        table.add_row(rank_name, _ids(option["agents"]), f"{option['cost']:.3f}", *parts)
    console.print(table)
    if len(options) > 1:
        console.print(f"the runner-up costs {options[1]['cost'] - options[0]['cost']:+.3f}", highlight=False)


def _ids(agent_ids: list[int]) -> str:
    return ", ".join(map(str, agent_ids))
