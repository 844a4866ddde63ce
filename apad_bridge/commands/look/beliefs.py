"""`musselbed beliefs RUN`: measures how good a run's beliefs were."""

from __future__ import annotations

import argparse
import sys
from dataclasses import asdict
from pathlib import Path
from typing import Any

from rich.table import Table

from apad_bridge.analysis.belief_scores.comparisons import Record, best_record, comparisons_in
from apad_bridge.analysis.belief_scores.scores import LOW_COVERAGE, Score, Scores, scores_of
from apad_bridge.commands.help_text import ending
from apad_bridge.runs.exits import Exit
from apad_bridge.runs.progress import WorkProgress
from apad_bridge.runs.rich_console import Console, print_result
from apad_bridge.scenario.errors import UserError

FIGURE_ENDINGS = (".png", ".svg", ".pdf")
"""The formats of `--figure`, here and in `musselbed fit battery`."""


def add_parser(commands: Any) -> None:
    parser = commands.add_parser(
        "beliefs",
        description="Compares the supervisor's beliefs with the truth, at times a period apart: by the age of the last "
        "packet, by mode and by aMussel. Reads the run's bags. Reads the journal where a bag is not closed, as of a "
        "flying run, or has no deviations of beliefs.",
        epilog=ending(
            "musselbed beliefs runs/sound-12-1",
            "musselbed beliefs runs/sound-12-1 --figure beliefs.png",
            note="See docs/beliefs.md.",
        ),
    )
    parser.add_argument("directory", type=Path, metavar="RUN", help="the run's directory")
    parser.add_argument(
        "--period",
        type=float,
        default=10.0,
        metavar="S",
        help="mission seconds between samples (default: 10)",
    )
    parser.add_argument(
        "--from",
        dest="record",
        choices=[it.value for it in Record],
        help="the record to read (default: the bag, if it is complete)",
    )
    parser.add_argument("--figure", type=Path, metavar="FILE", help="draw the result, as .png, .svg or .pdf")
    parser.add_argument("--json", action="store_true", help="print the result as JSON on stdout")


def run(arguments: argparse.Namespace) -> int:
    if not arguments.period >= 0.001:
        raise UserError(f"--period {arguments.period}: must be a millisecond or more")
    figure: Path | None = arguments.figure
    if figure is not None and figure.suffix not in FIGURE_ENDINGS:
        raise UserError(f"--figure {figure}: its name must end in one of {', '.join(FIGURE_ENDINGS)}")
    with WorkProgress(arguments.json) as progress:
        progress.step(f"reading {arguments.directory}")
        record, why_journal = (
            (Record(arguments.record), None) if arguments.record else best_record(arguments.directory)
        )
        scores = scores_of(comparisons_in(arguments.directory, round(1000 * arguments.period), record))
    if why_journal is not None:
        print(f"musselbed beliefs: {why_journal}; the journal is read instead", file=sys.stderr)
    if scores is None:
        raise UserError(
            f"{arguments.directory}: nothing to compare: in its {record}, no aMussel has both a belief and a truth"
        )
    if figure is not None:
        from apad_bridge.analysis.belief_scores.score_figure import draw

        draw(scores, figure, f"beliefs in {arguments.directory.name}")
    print_result(
        arguments.json, {"record": record, **asdict(scores)}, lambda: _show(scores, record, Console())
    )
    _warn(scores)
    return Exit.DONE


def _warn(scores: Scores) -> None:
    """Says on stderr which bins of beliefs claim to know more than they do."""
    console = Console(stderr=True, soft_wrap=True)
    for name, score in scores.overconfident.items():
        assert score.coverage is not None
        console.print(
            f"warning: {name}: the intervals of 95 % hold the truth in {score.coverage:.0%} of {score.samples} samples, "
            f"less than {LOW_COVERAGE:.0%}: a planner trusts these beliefs too much; let the scenario's beliefs.twin "
            "assume wider deviations",
            highlight=False,
            markup=False,
        )


def _show(scores: Scores, record: Record, console: Console) -> None:
    table = Table(
        padding=(0, 0, 0, 1),
        title=f"Belief error (estimate minus truth), from the run's {record}",
        caption="by the age of the newest packet, by mode, by aMussel; cover, width: of the 95 % interval; "
        "mode: share that is right; place: rms error in m, and the cover of its 95 % ellipse",
    )
    table.add_column("", min_width=12)
    for name in ("samples", "rmse", "bias", "cover", "width", "nees", "crps", "mode", "place", "cover"):
        # On a narrow screen the row names fold; the figures are not cut.
        table.add_column(name, justify="right", no_wrap=True, min_width=5)
    _row(table, "all", scores.overall)
    if scores.secondary is not None:
        _row(table, "secondary battery", scores.secondary)
    for head, bins in (
        ("packet up to", scores.by_age),
        ("mode", scores.by_mode),
        ("aMussel", scores.by_agent),
    ):
        table.add_section()
        table.add_row(f"[dim]{head}[/dim]")
        for name, score in bins.items():
            _row(table, name, score)
    console.print(table)
    if scores.overall.coverage is None:
        console.print("These beliefs claim to be certain: they have neither coverage nor consistency.")


def _row(table: Table, name: str, score: Score) -> None:
    table.add_row(
        name,
        str(score.samples),
        f"{score.rmse:.4f}",
        f"{score.bias:+.4f}",
        _or_dash(score.coverage, ".3f"),
        _or_dash(score.width, ".3f"),
        _or_dash(score.nees, ".2f"),
        f"{score.crps:.4f}",
        f"{score.mode_right:.3f}",
        _or_dash(score.place_rmse_m, ".2f"),
        _or_dash(score.place_coverage, ".3f"),
    )


def _or_dash(figure: float | None, form: str) -> str:
    return "-" if figure is None else format(figure, form)
