"""`musselbed fit battery`: fit a battery's charge or discharge curve to your own log."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from rich.table import Table

from apad_bridge.commands.help_text import ending
from apad_bridge.commands.look.beliefs import FIGURE_ENDINGS
from apad_bridge.field.battery_fit.battery_fit import (
    BatteryFit,
    Direction,
    along,
    direction_of,
    fit_log,
    minutes_to_full,
)
from apad_bridge.field.battery_fit.battery_log import (
    MINUTES_IN,
    VALUE_UNITS,
    LogFormat,
    read_log,
)
from apad_bridge.field.battery_fit.fit_figure import draw
from apad_bridge.runs.rich_console import Console, print_result
from apad_bridge.scenario.errors import UserError


def add_parser(commands: Any) -> None:
    parser = commands.add_parser(
        "fit",
        description="Fits the models of a scenario to measurements.",
        epilog=ending(
            "musselbed fit battery charge.csv discharge.csv",
            "musselbed fit battery charge.csv --segments 4 --figure charge.svg",
        ),
    )
    parts = parser.add_subparsers(dest="part", metavar="PART", required=True)
    battery = parts.add_parser(
        "battery",
        help="a piecewise-linear curve through a battery's log, as a scenario's board block",
        description="Fits a continuous piecewise-linear curve to the log of one charge or one discharge by least squares, "
        "breakpoints included. Prints residuals and the keys for a scenario's board block. A log of a charge and one of a "
        "discharge together give the whole block.",
        epilog=ending(
            "musselbed fit battery charge.csv discharge.csv",
            "musselbed fit battery charge.csv --segments 4 --figure charge.svg",
            note="See docs/battery-fit.md.",
        ),
    )
    battery.add_argument("logs", type=Path, nargs="+", metavar="LOG.csv", help="columns for time and voltage")
    battery.add_argument(
        "--segments",
        type=int,
        metavar="N",
        help="number of straight pieces (default: 3 charging, 1 discharging, as in the paper; charging along a curve: 3)",
    )
    battery.add_argument(
        "--direction",
        choices=[it.value for it in Direction],
        help="the direction of the log (default: detected)",
    )
    battery.add_argument(
        "--time-column", metavar="NAME", help="column of the time, if its name does not show it"
    )
    battery.add_argument("--value-column", metavar="NAME", help="column of the voltage, likewise")
    battery.add_argument(
        "--time-unit",
        choices=list(MINUTES_IN),
        help="unit of the time, if the column's name does not state it",
    )
    battery.add_argument(
        "--value-unit", choices=VALUE_UNITS, help="unit of the voltage, if neither name nor size shows it"
    )
    battery.add_argument(
        "--empty-mv", type=float, default=3600.0, metavar="MV", help="voltage of charge 0 (default: 3600)"
    )
    battery.add_argument(
        "--full-mv", type=float, default=4200.0, metavar="MV", help="voltage of charge 1 (default: 4200)"
    )
    battery.add_argument(
        "--lift-mv",
        type=float,
        default=0.0,
        metavar="MV",
        help="voltage by which the charger lifts a battery; counts where a discharge has several pieces (default: 0)",
    )
    battery.add_argument(
        "--figure",
        type=Path,
        metavar="FILE",
        help="draw rows, curve and residuals (of one log), as .png, .svg or .pdf",
    )
    battery.add_argument(
        "--json", action="store_true", help="print fit, residuals and block as JSON on stdout"
    )
    battery.set_defaults(run=run_battery)


def run_battery(arguments: argparse.Namespace) -> int:
    _refuse_contradictions(arguments)
    log_format = LogFormat(
        arguments.time_column,
        arguments.value_column,
        arguments.time_unit,
        arguments.value_unit,
        arguments.empty_mv,
        arguments.full_mv,
    )
    direction = Direction(arguments.direction) if arguments.direction else None
    logs = [read_log(path, log_format) for path in arguments.logs]
    logs.sort(key=lambda it: direction_of(it, direction), reverse=True)  # a discharge first
    if len({direction_of(it, direction) for it in logs}) < len(logs):
        raise UserError(
            f"both logs are {direction_of(logs[0], direction)}: give one log, or one of a charge and one of a discharge"
        )
    fits = [fit_log(logs[0], arguments.segments, direction)]
    for log in logs[1:]:
        lift = arguments.lift_mv / (arguments.full_mv - arguments.empty_mv)
        is_curved = len(fits[0].segments) > 1
        fits.append(fit_log(along(log, fits[0], lift)) if is_curved else fit_log(log, arguments.segments))
    if arguments.figure is not None:
        draw(fits[0], arguments.figure)
    return print_result(
        arguments.json,
        {"fits": [fitted.to_json() for fitted in fits], "board": block_of(fits)},
        lambda: _show(fits, Console()),
        indent=1,
    )


def _refuse_contradictions(arguments: argparse.Namespace) -> None:
    if arguments.segments is not None and arguments.segments < 1:
        raise UserError(f"--segments {arguments.segments}: one or more")
    if not arguments.empty_mv < arguments.full_mv:
        raise UserError("--empty-mv must lie below --full-mv")
    if len(arguments.logs) > 2:
        raise UserError("one log, or one of a charge and one of a discharge")
    if arguments.figure is not None and len(arguments.logs) > 1:
        raise UserError("--figure draws one log: fit them one by one")
    if arguments.figure is not None and arguments.figure.suffix not in FIGURE_ENDINGS:
        raise UserError(
            f"--figure {arguments.figure}: its name must end in one of {', '.join(FIGURE_ENDINGS)}"
        )


def block_of(fits: list[BatteryFit]) -> dict[str, Any]:
    """The keys of a scenario's `board` that follow from these logs.

    A discharge of several pieces is the curve of a whole board, whose charging is then a charge's and no voltage's.
    """
    block: dict[str, Any] = {}
    charging: dict[str, Any] = {}
    power = block
    for fitted in fits:
        if fitted.direction is Direction.CHARGING:
            charging["charge_segments"] = [list(segment) for segment in fitted.charge_segments]
            continue
        block["discharge_per_min"] = fitted.discharge_per_min
        if len(fitted.segments) > 1:
            curve = [list(point) for point in fitted.discharge_curve]
            power = {"metering": {"profile": "table-one", "discharge_curve": curve}}
            block["whole"] = {"power": power}
    power |= charging
    return block


def _show(fits: list[BatteryFit], console: Console) -> None:
    for fitted in fits:
        console.print(_table(fitted))
        console.print(
            f"RMSE {fitted.rmse:.5f}, largest residual {fitted.max_abs:.5f}, of {len(fitted.minutes)} rows"
        )
        for note in _notes(fitted):
            console.print(f"note: {note}", highlight=False)
    # Plain print, so that the block can be copied: a terminal's width must not fold it.
    print("\nboard: # agent time")
    _print_block(block_of(fits), "  ")


def _print_block(block: dict[str, Any], indent: str) -> None:
    for key, value in block.items():
        if isinstance(value, dict):
            print(f"{indent}{key}:")
            _print_block(value, indent + "  ")
        else:
            print(f"{indent}{key}: {value if isinstance(value, str) else _yaml(value)}")


def _table(fitted: BatteryFit) -> Table:
    table = Table(title=f"{fitted.log}: {fitted.direction}")
    for name in ("", "min", "to", "scaled", "to", "per min", "rows", "RMSE", "largest"):
        table.add_column(name, justify="right", no_wrap=True)
    for n, piece in enumerate(fitted.segments, 1):
        table.add_row(
            str(n),
            f"{piece.from_min:.1f}",
            f"{piece.to_min:.1f}",
            f"{piece.from_scaled:.4f}",
            f"{piece.to_scaled:.4f}",
            f"{piece.per_min:+.7f}",
            str(piece.rows),
            f"{piece.rmse:.4f}",
            f"{piece.max_abs:.4f}",
        )
    return table


def _notes(fitted: BatteryFit) -> list[str]:
    notes = []
    if fitted.outside:
        notes.append(f"{fitted.outside} rows before or after the range from empty to full were not used")
    if fitted.left_out:
        notes.append(f"{fitted.left_out} rows have no value")
    for start, end in fitted.gaps[:3]:
        notes.append(f"no rows from {start:.1f} to {end:.1f} min")
    if len(fitted.gaps) > 3:
        notes.append(f"and {len(fitted.gaps) - 3} gaps more")
    if fitted.direction is Direction.CHARGING:
        low, high = fitted.segments[0].from_scaled, fitted.segments[-1].to_scaled
        if low > 0.02 or high < 0.98:
            notes.append(
                f"the log runs from {low:.2f} to {high:.2f}: the end segments are prolonged to 0 and 1"
            )
        notes.append(f"from empty to full in {minutes_to_full(fitted.charge_segments):.1f} min")
    else:
        if len(fitted.segments) > 1:
            notes.append(
                "a board of the worst case discharges at the one rate of a straight line through all rows"
            )
        notes.append(f"from full to empty in {1 / fitted.discharge_per_min:.1f} min")
    return notes


def _yaml(value: Any) -> str:
    """A number or list in the decimals that the scenario's reader accepts: never with an exponent."""
    if isinstance(value, list):
        return f"[{', '.join(map(_yaml, value))}]"
    digits = f"{value:.10f}".rstrip("0")
    return digits + "0" if digits.endswith(".") else digits
