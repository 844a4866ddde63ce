"""Permission to execute the code of files that a scenario or a run names. Commands get it here, and nowhere else.

`run`, `script`, `study`, `mission` and `fleet` execute what a person typed, with the code that it names. Every other
command only looks, and executes such code with `--trust`.
"""

from __future__ import annotations

import argparse
import os
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from apad_bridge.planning.registry import Trust
    from apad_bridge.records.run_directory import RunDirectory


def add_trust_argument(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--trust",
        action="store_true",
        help="execute the code of files that are named there: it has your rights",
    )


def trust_of_typed() -> Trust:
    """The trust of a command that flies what a person typed."""
    from apad_bridge.planning.registry import Trust

    return Trust()


def trust_of_looked_at(arguments: argparse.Namespace, *typed: str) -> Trust | None:
    """The trust of a command that only looks. Without --trust it covers the files of strategies that were `typed`."""
    if not arguments.trust and not typed:
        return None
    # Imported here: the doctor needs none of it.
    from apad_bridge.planning.registry import InFile, Trust

    if arguments.trust:
        return Trust()
    files = frozenset(os.path.abspath(it.path) for it in map(InFile.of, typed) if it is not None)
    return Trust(files) if files else None


def trust_of_run(arguments: argparse.Namespace, directory: RunDirectory, *typed: str) -> Trust | None:
    """The same, of a command that continues a run. Of a run that this user began here all code is trusted."""
    from apad_bridge.planning.registry import Trust
    from apad_bridge.runs.trusted_runs import is_own

    return Trust() if is_own(directory) else trust_of_looked_at(arguments, *typed)
