"""`musselbed replay RUN [RUN2]`: a run, or two side by side, as one HTML page."""

from __future__ import annotations

import argparse
import webbrowser
from pathlib import Path
from typing import Any

from apad_bridge.commands.help_text import ending
from apad_bridge.runs.exits import Exit
from apad_bridge.runs.rich_console import print_result
from apad_bridge.scenario.errors import UserError


def add_parser(commands: Any) -> None:
    parser = commands.add_parser(
        "replay",
        description="Writes replay.html into a run's directory: one file that opens from disk, without a network. "
        "It shows the journal up to now, also of a flying or a killed run. With a second run, the page shows both side by "
        "side and what differs, in compared-with-RUN2.html.",
        epilog=ending(
            "musselbed replay runs/pool-12-1 --open", "musselbed replay runs/pool-12-1 runs/pool-12-2"
        ),
    )
    parser.add_argument("directory", type=Path, metavar="RUN", help="the run's directory")
    parser.add_argument(
        "other", type=Path, nargs="?", metavar="RUN2", help="the directory of a run to compare it with"
    )
    parser.add_argument("--open", action="store_true", help="open the page in the browser")
    parser.add_argument(
        "--json", action="store_true", help="print the page's path and size as JSON on stdout"
    )


def run(arguments: argparse.Namespace) -> int:
    from apad_bridge.analysis.replay.build import build_comparison, build_replay
    from apad_bridge.runs.progress import WorkProgress

    with WorkProgress(arguments.json) as progress:
        if arguments.other is None:
            progress.step(f"reading {arguments.directory}")
            page = build_replay(arguments.directory)
        else:
            progress.step(f"comparing {arguments.directory} with {arguments.other}")
            page = build_comparison(arguments.directory, arguments.other)
    print_result(arguments.json, {"page": str(page), "bytes": page.stat().st_size}, lambda: print(page))
    if arguments.open and not webbrowser.open(page.absolute().as_uri()):
        raise UserError(f"no browser could be started: open {page.absolute().as_uri()} in one")
    return Exit.DONE
