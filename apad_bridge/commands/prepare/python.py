"""`musselbed python FILE`: runs a Python file, pytest or pip in the environment of musselbed, from any folder."""

from __future__ import annotations

import argparse
import os
import sys
from typing import Any, NoReturn

from apad_bridge.commands.help_text import ending
from apad_bridge.scenario.errors import UserError


def add_parser(commands: Any) -> None:
    parser = commands.add_parser(
        "python",
        usage="musselbed python [-h] [-m MODULE | FILE.py] [ARGUMENT ...]",
        description="Runs Python with the packages that musselbed is installed with: pandas, matplotlib, pytest and "
        "musselbed's own. Each folder may be the current one.",
        epilog=ending(
            "musselbed python batteries.py",
            "musselbed python -m pytest test_board.py",
            "musselbed python -m pip install .",
            note="pytest comes with launch_scripts/install --mu. The exit code is that of Python.",
        ),
    )
    parser.add_argument(
        "-m",
        dest="module",
        nargs=argparse.REMAINDER,
        metavar="MODULE",
        help="run this module, as pytest or pip",
    )
    parser.add_argument(
        "file", nargs=argparse.REMAINDER, metavar="FILE.py", help="the file, and its arguments"
    )


def run(arguments: argparse.Namespace) -> NoReturn:
    words = arguments.file if arguments.module is None else ["-m", *arguments.module]
    if len(words) == words.count("-m"):
        raise UserError("name a file, or a module after -m: musselbed python -m pytest test_board.py")
    # numpy would have one thread: that is for our own commands.
    os.environ.pop("OPENBLAS_NUM_THREADS", None)
    sys.stdout.flush()
    os.execv(sys.executable, [sys.executable, *words])
