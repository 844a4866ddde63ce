"""`musselbed report RUN...`: runs as one page, which a browser prints, with their data beside them."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

from apad_bridge.commands.help_text import ending
from apad_bridge.records.run_directory import RunDirectory
from apad_bridge.runs.exits import Exit
from apad_bridge.runs.progress import WorkProgress
from apad_bridge.scenario.errors import UserError

_DATA = ("csv", "parquet")


def add_parser(commands: Any) -> None:
    parser = commands.add_parser(
        "report",
        description="Writes report.html, which a browser prints on A4. It shows the runs' figures side by side, and the "
        "paper's figures 5, 6 and 9 drawn from their data. It adds the energy by module and state, the quality of beliefs, "
        "and each fault with what followed. Every series goes into a folder for each run beside it.",
        epilog=ending(
            "musselbed report runs/pool-12-1",
            "musselbed report runs/pool-12-1 runs/pool-12-2 --out comparison --data parquet",
        ),
    )
    parser.add_argument("directories", type=Path, metavar="RUN", nargs="+", help="a run's directory")
    parser.add_argument(
        "--out", type=Path, default=Path("report"), metavar="DIR", help="the folder (default: report)"
    )
    parser.add_argument(
        "--data", choices=(*_DATA, "none"), default="csv", help="the form of every series (default: csv)"
    )
    parser.add_argument("--json", action="store_true", help="print the paths as JSON on stdout")


def run(arguments: argparse.Namespace) -> int:
    from apad_bridge.analysis.export.formats import Format, export
    from apad_bridge.analysis.report.contents import contents_of
    from apad_bridge.analysis.report.document import write_report

    out: Path = arguments.out
    try:
        with WorkProgress(arguments.json) as progress:
            directories = [RunDirectory.open(it) for it in arguments.directories]
            reports = []
            for it in directories:
                progress.step(f"reading {it.path}")
                reports.append(contents_of(it))
            names = [it.name for it in reports]
            if twice := {it for it in names if names.count(it) > 1}:
                raise UserError(
                    f"two runs are called {min(twice)}: the folders of their data would be one; rename one"
                )
            progress.step(f"drawing {out}")
            page = write_report(reports, out)
            for name, directory in zip(names, directories, strict=True):
                if arguments.data != "none":
                    progress.step(f"writing {out / name}")
                    export(directory, Format(arguments.data), out / name)
    except ImportError as error:
        raise UserError(f"--data parquet needs {error.name}: pip install 'musselbed[export]'") from error
    if arguments.json:
        data = [str(out / name) for name in names] if arguments.data != "none" else []
        print(json.dumps({"page": str(page), "data": data}))
    else:
        print(page)
    return Exit.DONE
