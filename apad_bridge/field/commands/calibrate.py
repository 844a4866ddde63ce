"""`musselbed calibrate BAG...`: a vehicle's own numbers from its logs, with intervals, as a scenario's keys."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.table import Table

from apad_bridge.commands.fly.run import namespace_of_shell
from apad_bridge.commands.help_text import ending
from apad_bridge.runs.progress import WorkProgress
from apad_bridge.runs.rich_console import Console, print_result, table_of
from apad_bridge.scenario.errors import UserError

if TYPE_CHECKING:
    from apad_bridge.field.calibration.calibration import Calibration, ReadBag
    from apad_bridge.field.calibration.losses import Loss

_ENDING = ending(
    "musselbed calibrate apad.bag --scenario launch_scripts/scenarios/real-apad.yaml",
    "musselbed calibrate monday.bag tuesday.bag --scenario real-apad.yaml --adrift 300:420 --out like-the-real.yaml",
    note="See docs/logs.md.",
)


def add_parser(commands: Any) -> None:
    parser = commands.add_parser(
        "calibrate",
        description="Measures speed, stopping distance, docking time and misses, drift, energy and the loss of packets "
        "by range in a vehicle's bags, of either generation. Each figure has its interval of 95 % and its number of "
        "samples. Prints the scenario's keys that follow, what a bag cannot tell, and why. Flies the go-tos again by the "
        "new numbers, and compares.",
        epilog=_ENDING,
    )
    parser.add_argument(
        "bags", type=Path, nargs="+", metavar="BAG", help="bags of the vehicle, or a run's run.bag"
    )
    parser.add_argument(
        "--scenario",
        type=Path,
        required=True,
        metavar="FILE",
        help="the scenario to calibrate; it names the aPad, and has what no bag tells: capacity, mass, drag",
    )
    parser.add_argument(
        "--adrift",
        type=_span,
        action="append",
        default=[],
        metavar="FROM:TO",
        help="seconds of the first bag, from its begin, in which the controllers were off (may be repeated)",
    )
    parser.add_argument(
        "--residuals",
        type=Path,
        action="append",
        default=[],
        metavar="BAG",
        help="compare with this mission, which was flown with the new numbers (default: the bags themselves)",
    )
    parser.add_argument("--out", type=Path, metavar="FILE", help="write the calibrated scenario, a new file")
    parser.add_argument("--json", action="store_true", help="print a JSON object")


def _span(text: str) -> tuple[float, float]:
    begin, _, end = text.partition(":")
    try:
        span = float(begin), float(end)
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text}: two numbers of seconds, as 300:420") from None
    if not 0 <= span[0] < span[1]:
        raise argparse.ArgumentTypeError(f"{text}: from 0 on, and the later second last")
    return span


def run(arguments: argparse.Namespace) -> int:
    # scipy's statistics take a second, which no other command should pay.
    from apad_bridge.field.calibration.calibration import calibrate, read_recording, with_block
    from apad_bridge.scenario.loader import load, write_resolved

    if arguments.out is not None and arguments.out.exists():
        raise UserError(f"{arguments.out} exists already: say a new file with --out")
    scenario = load(arguments.scenario)
    name, namespace = scenario.apad.name, namespace_of_shell()
    with WorkProgress(arguments.json) as progress:

        def read(bag: Path) -> ReadBag:
            progress.step(f"reading {bag}")
            return read_recording(bag, name, namespace)

        recordings, others = list(map(read, arguments.bags)), list(map(read, arguments.residuals))
        begin_s = _begin_s(recordings[0])
        adrift_s = tuple((begin_s + low, begin_s + high) for low, high in arguments.adrift)
        progress.step("measuring")
        found = calibrate(recordings, scenario, adrift_s, others)
    if arguments.out is not None:
        write_resolved(arguments.out, with_block(scenario, found.block))
    return print_result(arguments.json, found.to_json(), lambda: _show(found, Console()))


def _begin_s(recording: ReadBag) -> float:
    return min((it.at_s for it in recording.facts), default=0.0)


def _show(found: Calibration, console: Console) -> None:
    from apad_bridge.field.calibration.calibration import yaml_lines

    for note in found.notes:
        console.print(f"note: {note}", highlight=False, markup=False)
    headings = ("", "value", "from", "to", "unit", "samples", "method")
    table = table_of(
        "Measured, with the interval of 95 %", headings, ("", "unit", "method"), title_justify="left"
    )
    for name, it in found.figures.items():
        table.add_row(
            name, f"{it.value:.4g}", f"{it.low:.4g}", f"{it.high:.4g}", it.unit, str(it.samples), it.method
        )
    console.print(table)
    for medium, losses in (("sound", found.sound), ("Wi-Fi", found.wifi)):
        if losses:
            console.print(_losses(medium, losses))
    for name, reason in found.unmeasured.items():
        console.print(f"not measured: {name}: {reason}", highlight=False, markup=False, soft_wrap=True)
    residuals = found.residuals
    if residuals is not None and residuals.rms_s is not None and residuals.seconds is not None:
        seconds = residuals.seconds
        console.print(
            f"{residuals.go_tos} go-tos flown again: real minus simulated {seconds.value:+.2f} s "
            f"({seconds.low:+.2f} to {seconds.high:+.2f}), root mean square {residuals.rms_s:.2f} s, of "
            f"{residuals.mean_go_to_s:.1f} s each",
            highlight=False,
            soft_wrap=True,
        )
    else:
        console.print("no residuals: fewer than three completed go-tos with a known goal", highlight=False)
    # Plain print, so that the block can be copied: a terminal's width must not fold it.
    print("\n# for the scenario")
    print("\n".join(yaml_lines(found.block)))


def _losses(medium: str, losses: list[Loss]) -> Table:
    headings = ("range [m]", "lost %", "from", "to", "sent")
    table = table_of(f"Lost packets of {medium}, by range", headings, title_justify="left")
    for it in losses:
        end = "on" if it.to_m is None else f"to {it.to_m:g}"
        lost = it.lost
        table.add_row(
            f"{it.from_m:g} {end}",
            *(f"{100 * share:.1f}" for share in (lost.value, lost.low, lost.high)),
            str(lost.samples),
        )
    return table
