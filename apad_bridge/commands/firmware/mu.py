"""`musselbed mu`: runs Table I on one MU board, prints its energy budget for a script, and the diagram of its states."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable, Mapping
from dataclasses import asdict
from math import fsum
from pathlib import Path
from typing import TYPE_CHECKING, Any

from apad_bridge.commands.firmware.mu_conform import add_conform
from apad_bridge.commands.firmware.mu_program import BOARDS, WORST_CASE, is_program, run_program, write_vcd
from apad_bridge.commands.firmware.mu_script import Budget, budget_of, play, read_script
from apad_bridge.commands.help_text import ending
from apad_bridge.records.run_directory import RunDirectory
from apad_bridge.runs.exits import Exit
from apad_bridge.runs.rich_console import Console, print_result, table_of
from apad_bridge.scenario.errors import UserError
from firmware_model.bench.state_diagram import blocks
from firmware_model.bench.table_one_runs import ROWS, rows
from firmware_model.bench.trace import line
from firmware_model.table_one import ASSUMED, FITTED, METERED, METERING, TAKEN

if TYPE_CHECKING:
    from apad_bridge.analysis.energy.energy import AgentEnergy


def add_parser(commands: Any) -> None:
    parser = commands.add_parser(
        "mu",
        description="Runs the firmware model of one aMussel's MU board, without water, ROS or an aPad. `energy` sums "
        "the energy that the boards of a run drew.",
        epilog=ending("musselbed mu table1", "musselbed mu run night.yaml --trace"),
    )
    parts = parser.add_subparsers(dest="part", metavar="PART", required=True)
    table1 = parts.add_parser(
        "table1",
        help="run the paper's Table I on a board",
        description="Runs a board until its battery is empty or full, in each mode of the paper's Table I and in Fig. 4's "
        "heavy run, and lists the numbers that we fitted to it. Exit code 3 when a row leaves its bounds.",
        epilog=ending("musselbed mu table1", "musselbed mu table1 --json"),
    )
    table1.add_argument("--json", action="store_true", help="print rows and parameters as JSON on stdout")
    table1.set_defaults(run=run_table1)
    budget = parts.add_parser(
        "run",
        help="run a board from a small script, or with firmware of your own",
        description="Runs one board for the time in SCRIPT.yaml. Prints the energy of each module and each state, and the "
        "life of its batteries at that rate. With a program in place of the script it runs a board with that firmware "
        "through a dive, a dock and a brown-out, and prints what it does.",
        epilog=ending(
            "musselbed mu run night.yaml --trace",
            "musselbed mu run night.yaml --vcd night.vcd",
            "musselbed mu run ./board",
            note="docs/mu-scripts.md has a script to copy, and docs/firmware-port.md has firmware of your own.",
        ),
    )
    budget.add_argument("script", type=Path, metavar="SCRIPT.yaml|PROGRAM", help="a script, or firmware")
    budget.add_argument("--json", action="store_true", help="print the budget as JSON on stdout")
    budget.add_argument(
        "--vcd",
        type=Path,
        metavar="FILE",
        help="write states, rails, batteries, pins and packets for GTKWave",
    )
    budget.add_argument(
        "--trace", action="store_true", help="print all the board's actions before the budget"
    )
    budget.add_argument(
        "--profile",
        choices=tuple(BOARDS),
        default=WORST_CASE,
        help="the board of a program: the paper's worst case, or a whole one (default: worst-case)",
    )
    budget.set_defaults(run=run_script)
    add_conform(parts)
    energy = parts.add_parser(
        "energy",
        help="the energy that the boards of a run drew, by module and by state",
        description="Runs the aMussels of a run again, from their starts and the stimuli in the journal, and sums the "
        "energy of their boards so far. Docked, a part of that came from the charger.",
        epilog=ending(
            "musselbed mu energy runs/pool-12-1", "musselbed mu energy runs/pool-12-1 --agent 3 --json"
        ),
    )
    energy.add_argument("directory", type=Path, metavar="RUN", help="the run's directory")
    energy.add_argument(
        "--agent",
        type=int,
        action="append",
        default=[],
        metavar="ID",
        help="of this aMussel alone; can be repeated",
    )
    energy.add_argument("--json", action="store_true", help="each aMussel's energy as JSON on stdout")
    energy.set_defaults(run=run_energy)
    states = parts.add_parser(
        "states",
        help="print the diagram of the states, in Mermaid, and their powered rails",
        description="Prints the table of states as a diagram in Mermaid, and a table of the rails that each state powers.",
        epilog=ending("musselbed mu states", "musselbed mu states > states.md"),
    )
    states.set_defaults(run=run_states)


def run_table1(arguments: argparse.Namespace) -> int:
    result = table_one()
    print_result(arguments.json, result, lambda: _show_table_one(result, Console()), indent=1)
    return Exit.DONE if all(row["within"] for row in result["rows"]) else Exit.PEER_FAILED


def table_one() -> dict[str, Any]:
    """The `rows` of the paper and of the board, and the model's numbers with their sources.

    `metered_min` is the run of a board that reads its batteries' voltage instead of knowing their charge.
    """
    table = []
    for row, metered in zip(ROWS, rows(METERING), strict=True):
        run_min, metered_min = row.run(), metered.run()
        table.append(
            {
                "mode": row.mode,
                "paper_min": row.paper_min,
                "run_min": round(run_min, 2),
                "metered_min": round(metered_min, 2),
                "low_min": round(row.low_min, 2),
                "high_min": round(row.high_min, 2),
                "within": all(row.low_min <= found <= row.high_min for found in (run_min, metered_min)),
            }
        )
    return {
        "rows": table,
        "fitted": [asdict(parameter) for parameter in FITTED],
        "taken": [asdict(parameter) for parameter in TAKEN],
        "assumed": [asdict(parameter) for parameter in ASSUMED],
        "metered": [asdict(parameter) for parameter in METERED],
    }


def _show_table_one(result: dict[str, Any], console: Console) -> None:
    table = table_of(
        "Table I", ("mode", "paper (min)", "run (min)", "metered (min)", "bounds (min)"), ("mode",)
    )
    for row in result["rows"]:
        bounds = f"{row['low_min']:.0f} - {row['high_min']:.0f}"
        minutes = (f"{row['paper_min']:.0f}", f"{row['run_min']:.1f}", f"{row['metered_min']:.1f}")
        table.add_row(row["mode"], *minutes, bounds)
    console.print(table)
    headings = ("parameter", "value", "what it is", "fitted to")
    fitted = table_of("fitted here", headings, left=headings)
    for parameter in result["fitted"]:
        value = f"{parameter['value']:.10g} {parameter['unit']}"
        fitted.add_row(parameter["name"], value, parameter["source"], parameter["fitted_to"])
    console.print(fitted)
    for what, key in (
        ("the paper's own fits", "taken"),
        ("assumed, for Table I does not tell", "assumed"),
        ("of the battery monitor, in the column metered", "metered"),
    ):
        console.print(f"{what}:", style="bold")
        for parameter in result[key]:
            console.print(
                f"  {parameter['name']}: {parameter['value']:.10g} {parameter['unit']} ({parameter['source']})"
            )


def run_script(arguments: argparse.Namespace) -> int:
    if is_program(arguments.script):
        if arguments.json or arguments.trace:
            raise UserError("a program takes no --json or --trace: it prints its trace")
        return run_program(arguments.script, arguments.profile, arguments.vcd)
    script = read_script(arguments.script)
    bench = play(script)
    if arguments.vcd is not None:
        write_vcd(arguments.vcd, bench)
    budget = budget_of(script, bench)
    trace = [line(action) for action in bench.trace] if arguments.trace else None
    if arguments.json:
        print(json.dumps(asdict(budget) | ({} if trace is None else {"trace": trace}), indent=1))
        return Exit.DONE
    for text in trace or ():
        print(text)
    _show_budget(budget, Console())
    return Exit.DONE


def _show_budget(budget: Budget, console: Console) -> None:
    energy = "mWh" if budget.capacity_mwh is not None else "% of a battery"
    scale = 100 if budget.capacity_mwh is None else budget.capacity_mwh
    by_rail = table_of("by module", ("module", energy, "share"), ("module",))
    by_state = table_of("by state", ("state", energy, "hours"), ("state",))
    total = fsum(budget.by_rail.values()) or 1.0
    for name, drawn in sorted(budget.by_rail.items(), key=lambda item: -item[1]):
        by_rail.add_row(name, f"{drawn * scale:.3f}", f"{100 * drawn / total:.1f} %")
    for name, hours in sorted(
        budget.state_hours.items(), key=lambda item: -budget.by_state.get(item[0], 0.0)
    ):
        by_state.add_row(name, f"{budget.by_state.get(name, 0.0) * scale:.3f}", f"{hours:.3f}")
    console.print(by_rail, by_state)
    # A terminal may fold these lines; a pipe gets whole lines.
    console.print(
        f"after {budget.hours:g} h: {budget.state}, primary {budget.primary:.4f}, secondary {budget.secondary:.4f}, "
        f"{budget.samples} samples, {budget.dropped} stimuli dropped",
        soft_wrap=True,
    )
    console.print(_life(budget), soft_wrap=True)


def run_energy(arguments: argparse.Namespace) -> int:
    from apad_bridge.analysis.energy.energy import energy_of

    found = energy_of(RunDirectory.open(arguments.directory), tuple(dict.fromkeys(arguments.agent)))
    print_result(arguments.json, [asdict(it) for it in found], lambda: _show_energy(found, Console()))
    if strange := [it.agent_id for it in found if not it.is_exact]:
        print(
            f"warning: another version flew this run, or another codec: aMussels {', '.join(map(str, strange))} went "
            "another way than its journal says",
            file=sys.stderr,
        )
    return Exit.DONE


def _show_energy(found: list[AgentEnergy], console: Console) -> None:
    from apad_bridge.analysis.energy.energy import summed

    whose = f"aMussel {found[0].agent_id}" if len(found) == 1 else f"{len(found)} aMussels"
    columns: dict[str, Callable[[AgentEnergy], Mapping[str, float]]] = {
        "by module": lambda it: it.by_module,
        "by state": lambda it: it.by_state,
    }
    for title, of in columns.items():
        headings = (title[3:], "mean", "least", "most", "share")
        table = table_of(f"{whose}, {title}: % of a battery", headings, headings[:1])
        totals = summed(found, of)
        for name, drawn in totals.items():
            each = [of(it).get(name, 0.0) for it in found]
            share = drawn / (fsum(totals.values()) or 1.0)
            figures = (f"{100 * it:.3f}" for it in (drawn / len(found), min(each), max(each)))
            table.add_row(name.replace("_", " "), *figures, f"{100 * share:.1f} %")
        table.add_section()
        of_each = [fsum(of(it).values()) for it in found]
        figures = (f"{100 * it:.3f}" for it in (fsum(of_each) / len(found), min(of_each), max(of_each)))
        table.add_row("all", *figures, "100.0 %")
        console.print(table)


def _life(budget: Budget) -> str:
    if budget.life_hours is None:
        return "predicted life: not limited by this, for nothing was drawn"
    return (
        f"predicted life of a full primary at this rate: {budget.life_hours:.1f} h ({budget.life_hours / 24:.1f} days), "
        f"{budget.life_samples} samples; {_with_secondary(budget.lives)}"
    )


def _with_secondary(lives: float) -> str:
    if lives == 1:
        return "the secondary is a backup, on which it listens"
    return f"with the secondary {'twice' if lives == 2 else f'{lives:g} times'} that"


def run_states(arguments: argparse.Namespace) -> int:
    print(blocks(), end="")
    return Exit.DONE
