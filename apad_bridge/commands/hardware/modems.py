"""`musselbed modems FOLDER`: simulated nanomodems on a table, to try a bridge or a node's program without hardware."""

from __future__ import annotations

import argparse
import threading
from pathlib import Path
from typing import Any

from agents.hosting import interrupts
from apad_bridge.commands.help_text import ending
from apad_bridge.runs.exits import Exit
from apad_bridge.scenario.errors import UserError

_MOST = 16


def add_parser(commands: Any) -> None:
    parser = commands.add_parser(
        "modems",
        description="Opens simulated V3 nanomodems in one bowl of water, each as a serial device in FOLDER: modem1, modem2 "
        "and so on. Each hears the others. With them you can try `musselbed bridge`, and a node's own program, before the "
        "real modems come.",
        epilog=ending(
            "musselbed modems table",
            "musselbed modems table --count 3",
            note="It runs until Ctrl-C. The whole rehearsal: docs/mixing.md.",
        ),
    )
    parser.add_argument("folder", type=Path, metavar="FOLDER", help="the folder for the devices' names")
    parser.add_argument(
        "--count", type=int, default=2, metavar="N", help=f"the number of modems, 2 to {_MOST} (default: 2)"
    )


def run(arguments: argparse.Namespace) -> int:
    from apad_bridge.acoustics.serial.table_modems import TableModems

    if not 2 <= arguments.count <= _MOST:
        raise UserError(f"--count {arguments.count}: a table has 2 to {_MOST} modems")
    try:
        modems = TableModems(arguments.folder, arguments.count)
    except OSError as error:
        raise UserError(f"{arguments.folder}: {error.strerror}") from error
    asked_to_end = threading.Event()
    try:
        with interrupts.received_by(asked_to_end.set):
            for address in modems.modems:
                print(modems.path(address))
            print("9600 baud; Ctrl-C ends them", flush=True)
            asked_to_end.wait()
    finally:
        modems.close()
    return Exit.INTERRUPTED
