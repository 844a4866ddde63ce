"""Keeps the tries of a campaign as they come, several side by side, and goes on where it was interrupted.

A campaign has rows, and tries each of them for one generation of aPad software or both. A result is a line of JSON in
DIR/tries.jsonl: `row`, `generation`, `try`, and `error` where nothing was tried, or `failures`: none for a good try.
`in_cells` puts the results of a row and generation together, and `show` prints a table of them.
"""

from __future__ import annotations

import json
import os
import sys
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor, as_completed
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

ATTEMPTS = 3
"""A try that does not begin is begun again, up to so often."""
RESULTS = "tries.jsonl"

Result = dict[str, Any]


class NoFlight(Exception):
    """The try did not begin; the text is the reason."""


@dataclass(frozen=True, slots=True)
class Job:
    row: str
    generation: str
    number: int

    @property
    def name(self) -> str:
        return f"{self.row} {self.generation} {self.number}".replace(" ", "-")


def in_turns(cells: list[tuple[str, str, int]]) -> list[Job]:
    """So many tries of each (row, generation, tries). The first tries of all come first: an early end shows each row."""
    most = max((count for _, _, count in cells), default=0)
    return [Job(row, gen, number) for number in range(most) for row, gen, count in cells if number < count]


class Kept:
    """The results in a folder, a line of JSON each; what is whole there is not flown again."""

    def __init__(self, folder: Path) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self.folder = folder
        self._path = folder / RESULTS
        self._lock = threading.Lock()
        self.ended = threading.Event()
        """The campaign is over, and each flight with it."""
        self.results = [it for it in self._read() if "error" not in it]

    def _read(self) -> Iterator[dict[str, Any]]:
        if not self._path.exists():
            return
        data = self._path.read_bytes()
        whole = data[: data.rfind(b"\n") + 1]
        if whole != data:  # the last line of a campaign that was killed
            unfinished = self._path.with_suffix(".unfinished")
            unfinished.write_bytes(whole)
            unfinished.replace(self._path)
        for line in whole.splitlines():
            yield json.loads(line)

    def is_there(self, job: Job) -> bool:
        known = {(it["row"], it["generation"], it["try"]) for it in self.results}
        return (job.row, job.generation, job.number) in known

    def add(self, result: dict[str, Any]) -> None:
        with self._lock:
            self.results.append(result)
            with self._path.open("a") as out:
                out.write(json.dumps(result) + "\n")
                out.flush()
                os.fsync(out.fileno())


Fly = Callable[[Job, int], Result]
"""Flies a try, which is begun for the n-th time, n from 0. NoFlight, TimeoutError and OSError: it did not begin."""


def fly_all(
    chosen: list[Job], kept: Kept, side_by_side: int, fly: Fly, told: Callable[[Result], str]
) -> None:
    """Flies what is not there yet; prints each result by `told` on standard error as it comes."""
    missing = [it for it in chosen if not kept.is_there(it)]
    begun_s = time.monotonic()
    pool = ThreadPoolExecutor(side_by_side)
    try:
        futures = [pool.submit(_tried, it, kept, fly) for it in missing]
        for number, done in enumerate(as_completed(futures), len(chosen) - len(missing) + 1):
            where = f"{number}/{len(chosen)}, {(time.monotonic() - begun_s) / 60:.0f} min"
            print(f"[{where}] {_line(done, told)}"[:400], file=sys.stderr, flush=True)
    finally:
        kept.ended.set()
        pool.shutdown(cancel_futures=True)


def _line(done: Future[Result], told: Callable[[Result], str]) -> str:
    it = done.result()
    how = it["error"] if "error" in it else f"{told(it)}: {'; '.join(it['failures'][:2]) or 'good'}"
    return f"{it['row']}, {it['generation']}, try {it['try']}: {how}"


def _tried(job: Job, kept: Kept, fly: Fly) -> Result:
    """Flies one try; an error is a result too, and is flown again by the next campaign in that folder."""
    for attempt in range(ATTEMPTS):
        try:
            result = fly(job, attempt)
            break
        except (NoFlight, TimeoutError, OSError) as error:
            result = {"error": f"{type(error).__name__}: {error}"}
            if kept.ended.is_set():
                break
    result = {"row": job.row, "generation": job.generation, "try": job.number, **result}
    if not kept.ended.is_set():
        kept.add(result)
    return result


def in_cells(chosen: list[Job], kept: Kept) -> dict[tuple[str, str], list[Result]]:
    """The results of the chosen tries by row and generation."""
    wanted = {(it.row, it.generation, it.number) for it in chosen}
    cells: dict[tuple[str, str], list[Result]] = {(it.row, it.generation): [] for it in chosen}
    for it in kept.results:
        if (it["row"], it["generation"], it["try"]) in wanted:
            cells[it["row"], it["generation"]].append(it)
    return cells


def show(result: dict[str, Any], console: Console, under: str = "") -> None:
    """Prints a result: a list of rows as a table, all else as a line each. A row's lists stand below its table."""
    for name, value in result.items():
        title = f"{under}{_in_words(name)}"
        if isinstance(value, dict):
            show(value, console, f"{title}: ")
        elif isinstance(value, list) and value and isinstance(value[0], dict):
            _show_rows(title, value, console)
        else:
            console.print(f"{title}: {_in_short(value)}", markup=False)


def _show_rows(title: str, rows: list[Result], console: Console) -> None:
    names = dict.fromkeys(
        name for row in rows for name, cell in row.items() if not isinstance(cell, list | dict)
    )
    table = Table(*map(_in_words, names), title=title)
    for row in rows:
        table.add_row(*(_in_short(row.get(name)) for name in names))
    console.print(table)
    for row in rows:
        head = ", ".join(cell for cell in row.values() if isinstance(cell, str))
        for name, cell in row.items():
            lines = cell if isinstance(cell, list) else _short_items(cell) if isinstance(cell, dict) else []
            for line in lines:
                console.print(f"{head}: {_in_words(name)}: {_in_short(line)}", markup=False)


def _short_items(cell: dict[str, Any]) -> list[str]:
    return [", ".join(f"{_in_words(str(name))} {_in_short(value)}" for name, value in cell.items())]


def _in_words(name: str) -> str:
    return name.replace("_", " ")


def _in_short(value: Any) -> str:
    if isinstance(value, dict):
        return "; ".join(_short_items(value))
    if isinstance(value, list | tuple):
        return ", ".join(map(_in_short, value)) or "none"
    return "-" if value is None else f"{value:.4g}" if isinstance(value, float) else str(value)
