"""Rows of benchmarks, printed as they come: a benchmark of hours shows each result when it has it."""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from typing import Any, TypeVar

from rich.console import Console
from rich.progress import Progress

Row = TypeVar("Row", bound=dict[str, Any])
Job = TypeVar("Job")
Result = TypeVar("Result")


def told(row: Row) -> Row:
    """Prints a row as a line of JSON on standard error, and returns it."""
    print(json.dumps(row), file=sys.stderr, flush=True)
    return row


def side_by_side(fly: Callable[[Job], Result], jobs: Sequence[Job]) -> Iterator[tuple[Job, Result]]:
    """Each job with its result, in order, from as many processes as there are processors; a bar counts them."""
    with (
        Progress(console=Console(stderr=True), transient=True) as progress,
        ProcessPoolExecutor(os.cpu_count(), mp_context=get_context("spawn")) as pool,
    ):
        task = progress.add_task("flying", total=len(jobs))
        for job, result in zip(jobs, pool.map(fly, jobs), strict=True):
            yield job, result
            progress.advance(task)
