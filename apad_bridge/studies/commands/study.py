"""`musselbed study`: compare strategies on many random configurations, with confidence intervals."""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Callable, Iterable
from difflib import get_close_matches
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from apad_bridge.commands.help_text import ending
from apad_bridge.commands.trust import trust_of_typed
from apad_bridge.runs.exits import Exit
from apad_bridge.runs.rich_console import Console
from apad_bridge.scenario.errors import ScenarioError, UserError

if TYPE_CHECKING:
    from apad_bridge.studies.findings import Findings
    from apad_bridge.studies.runner import Fly
    from apad_bridge.studies.specification import StudyPlan

TABLE_TWO = "table2"
SLEEP = "sleep"
CAPACITY = "capacity"
_OUT = Path("studies")
_COLUMN_MM, _LEAST_MM, _MOST_MM = 84.0, 30.0, 400.0


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
            "musselbed study mine.yaml --figure threshold.pdf --width-mm 84 --table latex",
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
        "--fit",
        choices=("cautious", "greedy", "bay", "shipped"),
        help=f"searches starts for {TABLE_TWO} from which rows come out as in the paper: Cautious, Cautious and Greedy in "
        "the pool, or Greedy in the bay; shipped: the starts that were found so",
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
    parser.add_argument(
        "--figure",
        type=Path,
        metavar="FILE.pdf",
        help="write the primary figure over the one parameter that the study varies; also FILE.svg",
    )
    parser.add_argument(
        "--width-mm", type=float, metavar="MM", help=f"width of --figure (default: {_COLUMN_MM:g}, a column)"
    )
    parser.add_argument(
        "--table",
        choices=("latex", "csv"),
        help="print its differences to the first value as a table on stdout, nothing else",
    )


def run(arguments: argparse.Namespace) -> int:
    # Imported here: a study's parts are many, and the other commands start without them.
    from apad_bridge.studies.runner import StudyFailed, fly_study
    from apad_bridge.studies.study_report import RESULTS, write_parquet
    from apad_bridge.studies.sweep_figure import as_table, write_figure

    if find_spec("pyarrow") is None:
        raise UserError("pyarrow, which writes the results, is missing: run launch_scripts/install")
    plan, findings_of = _study_of(arguments)
    _check_outputs(arguments, plan)
    if any(it.fleet.firmware for it in plan.named):
        print("a study flies our firmware in place of fleet.firmware", file=sys.stderr)
    directory: Path = arguments.out or _OUT / plan.study.name
    workers = _workers(arguments) if arguments.dask is None else _on_dask(arguments)
    try:
        with _progress(arguments.json or arguments.table is not None) as progress:
            task = progress.add_task(plan.study.name, total=plan.missions)
            if plan.fitted_to:
                workers = _fitting(
                    plan.fitted_to, directory, workers, lambda text: progress.update(task, description=text)
                )
            rows = fly_study(plan, directory, workers, lambda missions: progress.advance(task, missions))
    except KeyboardInterrupt:
        print(f"musselbed study: ended; the same command continues from {directory}", file=sys.stderr)
        raise
    except StudyFailed as error:
        print(f"musselbed study: {error}", file=sys.stderr)
        return Exit.PEER_FAILED
    except OSError as error:
        raise UserError(f"{directory}: {error.strerror}: choose another place with --out") from error
    findings = findings_of(plan, rows)
    write_parquet(directory / RESULTS, plan, rows)
    figures = findings.write_figures(directory)
    if arguments.figure is not None and findings.sweep is not None:
        write_figure(findings.sweep, arguments.figure, arguments.width_mm or _COLUMN_MM)
    if arguments.table is not None and findings.sweep is not None:
        print(as_table(findings.sweep, arguments.table))
        return Exit.DONE
    if arguments.json:
        print(json.dumps({**findings.as_data(), "files": str(directory)}))
        return Exit.DONE
    console = Console(markup=False, highlight=False)
    for line in findings.lines(console.width):
        console.print(line, soft_wrap=isinstance(line, str))
    console.print(f"A row for each mission: {directory / RESULTS}", soft_wrap=True)
    console.print(figures, soft_wrap=True)
    return Exit.DONE


def _check_outputs(arguments: argparse.Namespace, plan: StudyPlan) -> None:
    """UserError, before anything is flown, for a figure or table that this study cannot give."""
    from apad_bridge.studies.sweep_figure import FIGURE_FORMATS, swept_key

    figure, width_mm = arguments.figure, arguments.width_mm
    if width_mm is not None and figure is None:
        raise UserError("--width-mm is of a figure: name its file by --figure")
    if width_mm is not None and not _LEAST_MM <= width_mm <= _MOST_MM:
        raise UserError(f"--width-mm {width_mm:g}: must be from {_LEAST_MM:g} to {_MOST_MM:g}")
    if figure is not None and figure.suffix not in FIGURE_FORMATS:
        raise UserError(f"--figure {figure}: must end in {' or '.join(FIGURE_FORMATS)}")
    if figure is not None and not figure.absolute().parent.is_dir():
        raise UserError(f"--figure {figure}: there is no such directory")
    if arguments.table is not None and arguments.json:
        raise UserError("--table and --json both print on stdout: leave one out")
    if (figure is not None or arguments.table is not None) and swept_key(plan) is None:
        raise UserError(
            "--figure and --table show a study over one parameter: give one key of `parameters` two values or more; "
            "theta is none, because figures at different theta do not compare"
        )


def _study_of(arguments: argparse.Namespace) -> tuple[StudyPlan, type[Findings]]:
    """The study that the arguments name, and the class of its findings. ScenarioError for a mistake in a file."""
    from apad_bridge.studies.capacity_diagram import CapacityDiagram, capacity_study
    from apad_bridge.studies.findings import Findings
    from apad_bridge.studies.rule_choice import RuleChoice, is_choice, rules_study
    from apad_bridge.studies.sleep_schedules import SleepSchedules, sleep_study
    from apad_bridge.studies.specification import is_scenario, load_study
    from apad_bridge.studies.table_two import TableTwo, table_two_study

    built_in: dict[str, tuple[Callable[..., StudyPlan], type[Findings]]] = {
        TABLE_TWO: (table_two_study, TableTwo),
        SLEEP: (sleep_study, SleepSchedules),
        CAPACITY: (capacity_study, CapacityDiagram),
    }
    given = {"seeds": arguments.seeds, "theta": arguments.theta}
    given = {option: value for option, value in given.items() if value is not None}
    for option, value in given.items():
        if value < 1:
            raise UserError(f"--{option} {value}: must be 1 or more")
    if "theta" in given and arguments.study != TABLE_TWO:
        raise UserError(f"--theta works with {TABLE_TWO} only: give a study `parameters: {{theta: [...]}}`")
    if arguments.fit is not None:
        if arguments.study != TABLE_TWO or "theta" in given:
            raise UserError(f"--fit works with {TABLE_TWO} at the paper's theta: leave it out, or --theta")
        from apad_bridge.studies.fitted_starts import FOUND, FittedStarts, fitted_study

        if arguments.fit == FOUND and "seeds" in given:
            raise UserError(f"--fit {FOUND} has one start of each scenario: leave out --seeds")
        return fitted_study(arguments.fit, **given), FittedStarts
    if arguments.study in built_in:
        plan_of, findings_of = built_in[arguments.study]
        return plan_of(**given), findings_of
    path = Path(arguments.study)
    try:
        plan_of = rules_study if is_scenario(path) else load_study
    except ScenarioError as error:
        raise UserError(_unknown(arguments.study, built_in)) from error
    plan = plan_of(path, **given, trust=trust_of_typed())
    return plan, RuleChoice if is_choice(plan) else Findings


def _unknown(name: str, built_in: Iterable[str]) -> str:
    from apad_bridge.scenario.loader import SHIPPED

    scenarios = sorted(it.stem for it in SHIPPED.glob("*.yaml"))
    near = get_close_matches(name, [*built_in, *scenarios], n=1)
    meant = f"did you mean {near[0]}?" if near else f"there are {', '.join(scenarios)}"
    return (
        f"{name}: neither a file nor a built-in study ({', '.join(built_in)}) nor a shipped scenario: {meant}"
    )


def _workers(arguments: argparse.Namespace) -> int:
    if arguments.workers is None:
        return len(os.sched_getaffinity(0))
    if arguments.workers < 1:
        raise UserError(f"--workers {arguments.workers}: must be 1 or more")
    return int(arguments.workers)


def _fitting(goal: str, directory: Path, workers: int | Fly, report: Callable[[str], None]) -> Fly:
    if not isinstance(workers, int):
        raise UserError("--fit searches on this machine: leave out --dask")
    from apad_bridge.studies.fitted_starts import fly_fitted

    return fly_fitted(goal, directory, workers, report)


def _on_dask(arguments: argparse.Namespace) -> Fly:
    if arguments.workers is not None:
        raise UserError("--workers is of this machine: a cluster has its own, leave it out with --dask")
    if find_spec("distributed") is None:
        raise UserError("--dask needs Dask: pip install 'musselbed[studies]'")
    from apad_bridge.studies.dask_cluster import fly_on_dask

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
