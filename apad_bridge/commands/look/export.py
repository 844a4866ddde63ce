"""`musselbed export RUN --to FORMAT`: every series of a run for other programs."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from apad_bridge.analysis.export.formats import Format, default_path, export
from apad_bridge.commands.help_text import ending
from apad_bridge.records.run_directory import RunDirectory
from apad_bridge.runs.progress import WorkProgress
from apad_bridge.runs.rich_console import print_result
from apad_bridge.scenario.errors import UserError


def add_parser(commands: Any) -> None:
    parser = commands.add_parser(
        "export",
        description="Writes the samples of a run's bags, the events of its journal, uploaded samples and the summary. MCAP "
        "opens in Foxglove and Lichtblick with the layout of `musselbed layout`; in the form of ROS 2 it opens in "
        "Rerun and ROS 2; .mat opens in MATLAB and Octave. Also of a run that still flies or that was killed.",
        epilog=ending(
            "musselbed export runs/pool-12-1 --to mcap",
            "musselbed export runs/pool-12-1 --to csv --out tables",
        ),
    )
    parser.add_argument("directory", type=Path, metavar="RUN", help="the run's directory")
    parser.add_argument(
        "--to",
        choices=[it.value for it in Format],
        required=True,
        help="mcap: as the bag; ros2: an MCAP in ROS 2's form; csv and parquet: a file for each series",
    )
    parser.add_argument(
        "--out",
        type=Path,
        metavar="PATH",
        help="the file, or the folder of csv and parquet (default: in the run's directory)",
    )
    parser.add_argument(
        "--json", action="store_true", help="print the path and the rows of each series as JSON"
    )


def run(arguments: argparse.Namespace) -> int:
    try:
        directory = RunDirectory.open(arguments.directory)
        path = arguments.out or default_path(directory, Format(arguments.to))
        with WorkProgress(arguments.json) as progress:
            progress.step(f"writing {path}")
            counts = export(directory, Format(arguments.to), path)
    except ImportError as error:
        raise UserError(f"--to {arguments.to} needs {error.name}: pip install 'musselbed[export]'") from error
    return print_result(arguments.json, {"path": str(path), "rows": counts}, lambda: print(path))
