"""`musselbed pack STUDY|RUN`: pack a study or a run as an archive that repeats its own figures."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from apad_bridge.commands.help_text import ending
from apad_bridge.runs.progress import WorkProgress
from apad_bridge.runs.rich_console import print_result


def add_parser(commands: Any) -> None:
    parser = commands.add_parser(
        "pack",
        description="Packs scenarios, seeds, versions of packages, records and results. The archive's script `repeat.sh` "
        "flies everything again and compares the figures.",
        epilog=ending(
            "musselbed pack studies/pool",
            "musselbed pack runs/pool-12-1 --out pool.tar.gz",
            note="See docs/studies.md.",
        ),
    )
    parser.add_argument(
        "directory", type=Path, metavar="STUDY|RUN", help="the directory of a study or of a run"
    )
    parser.add_argument(
        "--out", type=Path, metavar="FILE.tar.gz", help="the archive (default: NAME.tar.gz, here)"
    )
    parser.add_argument("--json", action="store_true", help="print the archive's path and size as JSON")


def run(arguments: argparse.Namespace) -> int:
    # Imported here: packing needs the parts of studies.
    from apad_bridge.studies.packing import pack

    with WorkProgress(arguments.json) as progress:
        progress.step(f"packing {arguments.directory}")
        archive = pack(arguments.directory, arguments.out)
    return print_result(
        arguments.json, {"path": str(archive), "bytes": archive.stat().st_size}, lambda: print(archive)
    )
