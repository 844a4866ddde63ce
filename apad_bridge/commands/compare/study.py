"""`musselbed study`: compares strategies on many configurations, or repeats the paper's Table II on them."""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from statistics import fmean
from typing import TYPE_CHECKING, Any

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table

from apad_bridge.commands.help_text import ending
from apad_bridge.runs.exits import Exit, UserError
from apad_bridge.scenario.errors import ScenarioError

if TYPE_CHECKING:
    from apad_bridge.assembly.capacity import Bounds
    from apad_bridge.runs.studies.capacity_diagram import SizedFlights
    from apad_bridge.runs.studies.report import Comparison
    from apad_bridge.runs.studies.rule_choice import Choice
    from apad_bridge.runs.studies.runner import Fly, Row
    from apad_bridge.runs.studies.sleep_schedules import ScheduleOutcome
    from apad_bridge.runs.studies.specification import StudyPlan

TABLE_TWO = "table2"
SLEEP = "sleep"
CAPACITY = "capacity"
DIAGRAM = "diagram.svg"
_OUT = Path("studies")
_BETWEEN_COLUMNS = 3
_SLEEP_SEEDS = 5
"""Whole boards are flown tick by tick: twelve schedules on one configuration take some minutes of a processor."""
_CAPACITY_SEEDS = 5
"""The diagram has 112 cells, and a flight of ten days takes about a second of a processor."""


def add_parser(commands: Any) -> None:
    parser = commands.add_parser(
        "study",
        description="Flies strategies x scenarios x seeds x parameters, each strategy on the same configurations, and "
        "prints means, paired differences and upper bounds. After an interruption the same command continues the study. "
        f"`musselbed study {TABLE_TWO}` repeats the paper's Table II, and `musselbed study {SLEEP}` compares schedules of "
        f"sleep and recommends one. `musselbed study {CAPACITY}` maps from which fleets and start charges the docks hold a "
        "fleet. `musselbed study SCENARIO` flies rules of collecting and releasing on random configurations of a "
        "scenario, and recommends one. Results: "
        "results.parquet with a row for each mission, report.html with figures.",
        epilog=ending(
            "musselbed study launch_scripts/studies/pool.yaml",
            "musselbed study launch_scripts/studies/pool.yaml --seeds 1000 --json",
            f"musselbed study {TABLE_TWO} --theta 1 --seeds 50",
            f"musselbed study {SLEEP} --seeds 10",
            f"musselbed study {CAPACITY}",
            "musselbed study pool-12 --seeds 20",
            note="See docs/studies.md.",
        ),
    )
    parser.add_argument(
        "study",
        metavar="STUDY.yaml",
        help=f"the study's file, or {TABLE_TWO}, {SLEEP}, {CAPACITY}, or a scenario",
    )
    parser.add_argument("--seeds", type=int, metavar="N", help="seeds 1 to N, instead of the study's")
    parser.add_argument(
        "--theta", type=int, metavar="N", help=f"theta of {TABLE_TWO}, instead of the paper's 30"
    )
    parser.add_argument(
        "--workers", type=int, metavar="N", help="number of processes (default: one for each processor)"
    )
    parser.add_argument(
        "--dask", metavar="ADDRESS", help="fly on the Dask cluster with this scheduler, as tcp://host:8786"
    )
    parser.add_argument(
        "--out",
        type=Path,
        metavar="DIR",
        help=f"directory of its files (default: {_OUT}/NAME); one study each",
    )
    parser.add_argument(
        "--json", action="store_true", help="print the results as JSON on stdout, nothing else"
    )
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    # Imported here: a study's parts are many, and the other commands start without them.
    from apad_bridge.runs.studies.capacity_diagram import borders_of, phases_of, write_diagram
    from apad_bridge.runs.studies.report import (
        REPORT,
        RESULTS,
        as_data,
        comparisons,
        write_parquet,
        write_report,
    )
    from apad_bridge.runs.studies.rule_choice import KNOWN, choice_of
    from apad_bridge.runs.studies.runner import AnotherStudy, StudyFailed, fly_study
    from apad_bridge.runs.studies.sleep_schedules import reason_of, schedules_of
    from apad_bridge.runs.studies.table_two import apad_energy, contradictions, table_two

    if find_spec("pyarrow") is None:
        raise UserError("pyarrow, which writes the results, is missing: run launch_scripts/install")
    plan = _plan_of(arguments)
    if any(it.fleet.firmware for it in plan.named):
        print("a study flies our firmware in place of fleet.firmware", file=sys.stderr)
    workers = _workers(arguments) if arguments.dask is None else _on_dask(arguments)
    is_table_two = arguments.study == TABLE_TWO
    stem = (
        plan.study.name
        if not is_table_two or arguments.theta is None
        else f"{TABLE_TWO}-theta{arguments.theta}"
    )
    directory: Path = arguments.out or _OUT / stem
    try:
        with _progress(arguments.json) as progress:
            task = progress.add_task(plan.study.name, total=plan.missions)
            rows = fly_study(plan, directory, workers, lambda missions: progress.advance(task, missions))
    except AnotherStudy as error:
        raise UserError(str(error)) from error
    except KeyboardInterrupt:
        print(f"musselbed study: ended; the same command continues from {directory}", file=sys.stderr)
        raise
    except StudyFailed as error:
        print(f"musselbed study: {error}", file=sys.stderr)
        return Exit.PEER_FAILED
    except OSError as error:
        raise UserError(f"{directory}: {error.strerror}: choose another place with --out") from error
    found = comparisons(plan, rows)
    write_parquet(directory / RESULTS, plan, rows)
    compared = table_two(plan, rows) if is_table_two else []
    schedules = schedules_of(plan, rows) if arguments.study == SLEEP else []
    phases = phases_of(plan, rows) if arguments.study == CAPACITY else []
    choice = choice_of(rows, KNOWN) if set(KNOWN) <= set(plan.strategies) else None
    if phases:  # a figure for each of its many settings would say less
        write_diagram(directory / DIAGRAM, phases, found[0].bounds)
    else:
        write_report(directory / REPORT, plan, rows, found)
    if arguments.json:
        slept = (
            {"schedules": [asdict(it) for it in schedules], "reason": reason_of(schedules)}
            if schedules
            else {}
        )
        paper = {"table2": compared, "contradictions": contradictions()} if is_table_two else {}
        held = {"phases": [asdict(it) for it in phases]} if phases else {}
        chosen = {"choice": asdict(choice)} if choice else {}
        parts = {**paper, **slept, **held, **chosen}
        print(json.dumps({**as_data(plan, found), **parts, "files": str(directory)}))
        return Exit.DONE
    console = Console(markup=False, highlight=False)
    if is_table_two:
        _print_table_two(console, compared, contradictions(), apad_energy(plan, rows))
    if schedules:
        _print_schedules(console, schedules, reason_of(schedules))
    if phases:
        _print_phases(console, phases, list(borders_of(phases)), found[0].bounds)
        console.print(f"The diagram: {directory / DIAGRAM}", soft_wrap=True)
    if choice:
        _print_choice(console, plan, rows, choice)
    for each in () if schedules or phases or choice else found:
        _print_comparison(console, each, plan.baseline, plan.study.primary)
    console.print(f"A row for each mission: {directory / RESULTS}", soft_wrap=True)
    if not phases:
        console.print(f"Tables and figures, for a browser: {directory / REPORT}", soft_wrap=True)
    return Exit.DONE


def _plan_of(arguments: argparse.Namespace) -> StudyPlan:
    from apad_bridge.runs.studies.capacity_diagram import capacity_study
    from apad_bridge.runs.studies.rule_choice import TRIALS, rules_study
    from apad_bridge.runs.studies.sleep_schedules import sleep_study
    from apad_bridge.runs.studies.specification import is_scenario, load_study, with_seeds
    from apad_bridge.runs.studies.table_two import THETA, table_two_study

    if arguments.seeds is not None and arguments.seeds < 1:
        raise UserError(f"--seeds {arguments.seeds}: must be 1 or more")
    try:
        if arguments.study == TABLE_TWO:
            return table_two_study(arguments.seeds or 200, arguments.theta or THETA)
        if arguments.theta is not None:
            raise UserError(
                f"--theta works with {TABLE_TWO} only: give a study `parameters: {{theta: [...]}}`"
            )
        if arguments.study == SLEEP:
            return sleep_study(arguments.seeds or _SLEEP_SEEDS)
        if arguments.study == CAPACITY:
            return capacity_study(arguments.seeds or _CAPACITY_SEEDS)
        if is_scenario(Path(arguments.study)):
            return rules_study(Path(arguments.study), arguments.seeds or TRIALS)
        plan = load_study(Path(arguments.study))
        return plan if arguments.seeds is None else with_seeds(plan, arguments.seeds)
    except ScenarioError as error:
        raise UserError(str(error)) from error


def _workers(arguments: argparse.Namespace) -> int:
    if arguments.workers is None:
        return len(os.sched_getaffinity(0))
    if arguments.workers < 1:
        raise UserError(f"--workers {arguments.workers}: must be 1 or more")
    return int(arguments.workers)


def _on_dask(arguments: argparse.Namespace) -> Fly:
    if arguments.workers is not None:
        raise UserError("--workers is of this machine: a cluster has its own, leave it out with --dask")
    if find_spec("distributed") is None:
        raise UserError("--dask needs Dask: pip install 'musselbed[studies]'")
    from apad_bridge.runs.studies.dask_cluster import fly_on_dask

    return partial(fly_on_dask, address=arguments.dask)


def _progress(is_quiet: bool) -> Progress:
    return Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("missions"),
        TimeRemainingColumn(),
        console=Console(stderr=True, quiet=is_quiet),
        transient=True,
    )


def _print_comparison(console: Console, found: Comparison, baseline: str, primary: str) -> None:
    """Prints a line for each column, so that the strategies fit beside each other on a narrow terminal.

    The planned comparison, of the primary column, follows as a sentence for each strategy.
    """
    from apad_bridge.runs.studies.figures import COLUMNS
    from apad_bridge.runs.studies.report import HEADINGS, NO_ENERGY, difference_text, estimate_text

    means = {it.strategy: [estimate_text(it.columns[column]) for column in COLUMNS] for it in found.standings}
    differences = {
        it.strategy: [difference_text(it.differences[column]) for column in COLUMNS]
        for it in found.standings
        if it.differences
    }
    titles = (f"{found.setting.label}, best first", f"minus {baseline}, on the same configurations")
    for title, cells in zip(titles, (means, differences), strict=True):
        for strategies in _that_fit(cells, console.width - max(map(len, HEADINGS.values()))):
            table = _table(title, ["", *strategies])
            for row, column in enumerate(COLUMNS):
                table.add_row(HEADINGS[column], *(cells[it][row] for it in strategies))
            console.print(table)
    for it in found.standings:
        if it.differences:
            difference = difference_text(it.differences[primary])
            console.print(
                f"{primary}, as planned: {it.strategy} {difference} against {baseline}.", soft_wrap=True
            )
    console.print(found.bounds.text, soft_wrap=True)
    if found.setting.theta != 1:
        console.print(f"{NO_ENERGY}.", soft_wrap=True)
    console.print()


def _print_table_two(
    console: Console, compared: Sequence[dict[str, Any]], notes: Sequence[str], energy: str | None
) -> None:
    from apad_bridge.runs.studies.table_two import COLUMNS, PAPER, THETA

    is_papers = any(it["percentile"] is not None for it in compared)
    title = "the paper's Table II beside ours, and the percentile of each of its values among ours"
    if not is_papers:
        title = f"Table II at another theta: the paper's figures are at {THETA}, so these do not compare"
    table = _table(title, ["", *COLUMNS.values()])
    shown = {"median": "ours, median", "p5": "ours, 5 %", "p95": "ours, 95 %"}
    if is_papers:
        shown = {"paper": "paper", **shown, "percentile": "percentile of the paper"}
    for row in PAPER:
        mark = " *" if row.contradicts_itself and is_papers else ""
        table.add_row(f"{row.name}{mark}", style="bold")
        cells = {it["column"]: it for it in compared if it["row"] == row.name}
        for key, heading in shown.items():
            values = [cells[column][key] for column in COLUMNS]
            table.add_row(f"  {heading}", *("–" if it is None else f"{it:.2f}" for it in values))
    console.print(table)
    for note in notes if is_papers else ():
        console.print(f"* {note}", soft_wrap=True)
    if energy is not None:
        console.print(energy, soft_wrap=True)
    console.print()


def _print_schedules(console: Console, schedules: Sequence[ScheduleOutcome], reason: str) -> None:
    title = "schedules of sleep, the recommended one first: means over the configurations"
    # In lines, so that a screen of 80 columns cuts no number.
    headings = (
        "wake\nevery\nmin",
        "sen-\nsors\ns",
        "pro-\ncess\ns",
        "lost",
        "samples\ntaken",
        "longest\ngap h",
        "dead\nh",
        "way\nplan-\nned m",
        "docks\nsus-\ntain",
    )
    table = _table(title, headings)
    for it in schedules:
        table.add_row(
            *(f"{it.alarm_s / 60:g}", f"{it.sample_s:g}", f"{it.processing_s:g}", f"{it.amussels_lost:.2f}"),
            *(f"{it.samples_taken:.0f}", f"{it.longest_gap_h:.1f}", f"{it.dead_time_h:.1f}"),
            *(f"{it.metres:.0f}", f"{it.sustained:.1f}"),
        )
    console.print(table)
    console.print(f"Recommended: {schedules[0].text}. {reason}", soft_wrap=True)


def _print_choice(console: Console, plan: StudyPlan, rows: Sequence[Row], choice: Choice) -> None:
    """Prints a line for each rule, and the chosen one as the lines of a scenario."""
    from apad_bridge.runs.studies.rule_choice import LEAST, LOST, METRES, RULES, UPTIME, keys_of

    headings = ("", "lost", "uptime %", "least %", "way m")
    table = _table(f"rules for {plan.named[0].name}, means of {len(plan.seeds)} configurations", headings)
    for rule in plan.strategies:
        own = [row for row in rows if row["strategy"] == rule]
        cells = [f"{fmean(row[key] for row in own):.1f}" for key in (LOST, UPTIME, LEAST, METRES)]
        table.add_row(rule, *cells, style="bold" if rule == choice.rule else "")
    console.print(table)
    if choice.rule not in RULES:
        console.print(
            f"Recommended: {choice.rule}. No other rule has more uptime without another cost.", soft_wrap=True
        )
        return
    console.print(
        f"Recommended: {choice.rule}, one by one, with exchanged places. Against {choice.better!r} it has "
        f"{choice.uptime:+.1f} points of uptime, {choice.least:+.1f} for the least aMussel, and {choice.metres:+.0f} m of "
        "way. It has the most uptime of the rules that lose no more aMussels, leave the least aMussel no worse and drive "
        "no more. In the scenario:",
        soft_wrap=True,
    )
    console.print("mission:")
    for key, value in keys_of(choice.rule, plan.named[0]).items():
        console.print(f"  {key}: {value if isinstance(value, str) else json.dumps(value)}")
    console.print()


def _print_phases(
    console: Console,
    phases: Sequence[SizedFlights],
    borders: Sequence[tuple[str, int, float | None]],
    bounds: Bounds,
) -> None:
    """Prints a table for each strategy: the flights that were held, by size of the fleet and mean charge at the start."""
    charges = sorted({it.start_charge for it in phases})
    for strategy in dict.fromkeys(it.strategy for it in phases):
        own = {(it.amussels, it.start_charge): it for it in phases if it.strategy == strategy}
        title = f"{strategy}: flights held, of {phases[0].flown}, by mean charge at the start"
        table = _table(title, ["aMussels", *(f"{it:g}" for it in charges), "held from"])
        for name, amussels, least in borders:
            if name == strategy:
                cells = [str(own[amussels, it].held) for it in charges]
                table.add_row(str(amussels), *cells, "never" if least is None else f"{least:g}")
        console.print(table)
    console.print(
        f"The docks sustain at most {bounds.sustained:.1f} aMussels, and {bounds.sustained_from_empty:.1f} if each charge "
        "begins at empty. Between the two it depends on the start: a fleet that begins low stays low.",
        soft_wrap=True,
    )


def _that_fit(cells: dict[str, list[str]], width: int) -> Iterator[list[str]]:
    """The strategies in groups whose columns fit beside each other, in their order."""
    group: list[str] = []
    used = 0
    for name, texts in cells.items():
        wanted = max(map(len, [name, *texts])) + _BETWEEN_COLUMNS
        if group and used + wanted > width:
            yield group
            group, used = [], 0
        group, used = [*group, name], used + wanted
    if group:
        yield group


def _table(title: str, headings: Sequence[str]) -> Table:
    table = Table(title=title, title_justify="left", box=SIMPLE_HEAD, pad_edge=False)
    for heading in headings:
        table.add_column(heading, justify="right" if heading else "left", no_wrap=True)
    return table
