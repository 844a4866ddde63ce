"""Flies the rows' tries, several side by side, keeps each result as it comes, and goes on where it was interrupted."""

from __future__ import annotations

import json
import os
import random
import shutil
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor, as_completed
from contextlib import ExitStack
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from benchmarks.safety_study.flight import Flight, NoFlight
from benchmarks.safety_study.judge import judge
from benchmarks.safety_study.rows import ROWS, SHORT_TRIES, Try

SEED = 20261124
FLIGHTS = 3
"""A flight that does not begin is begun again, up to so often."""
RESULTS = "tries.jsonl"
KEPT = ("wire.out", "run-*.out", "watchdog-*.out", "hull-*.out")
LONGER_S = 600.0
"""The mission lasts so much longer than the row's --minutes."""


@dataclass(frozen=True, slots=True)
class Job:
    row: str
    generation: str
    number: int

    @property
    def name(self) -> str:
        return f"{self.row} {self.generation} {self.number}".replace(" ", "-")


def jobs(rows: list[str], generations: list[str], tries: int | None, *, short: bool) -> list[Job]:
    """Each try of the chosen rows. The first tries of all rows come first, so that an early end shows each row."""
    cells = [
        (name, generation, tries or (SHORT_TRIES if short else row.tries))
        for name, row in ROWS.items()
        if (name in rows if rows else row.is_short or not short)
        for generation in row.generations
        if generation in generations
    ]
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


def fly(chosen: list[Job], kept: Kept, side_by_side: int, minutes: float) -> None:
    """Flies what is not there yet; prints each result on standard error as it comes."""
    missing = [it for it in chosen if not kept.is_there(it)]
    begun_s = time.monotonic()
    pool = ThreadPoolExecutor(side_by_side)
    try:
        futures = [pool.submit(_tried, it, kept, minutes) for it in missing]
        for number, done in enumerate(as_completed(futures), 1):
            _tell(done, len(chosen) - len(missing) + number, len(chosen), time.monotonic() - begun_s)
    finally:
        kept.ended.set()
        pool.shutdown(cancel_futures=True)


def _tell(done: Future[dict[str, Any]], number: int, count: int, seconds: float) -> None:
    it = done.result()
    how = it.get("error") or "; ".join(it["failures"][:2]) or "good"
    figures = (
        "" if "error" in it else f" stop {_figure(it['stop_s'])} s, coasting {_figure(it['coasting_m'])} m:"
    )
    line = f"[{number}/{count}, {seconds / 60:.0f} min] {it['row']}, {it['generation']}, try {it['try']}:{figures} {how}"
    print(line[:400], file=sys.stderr, flush=True)


def _figure(value: float | None) -> str:
    return "-" if value is None else f"{value:g}"


def _tried(job: Job, kept: Kept, minutes: float) -> dict[str, Any]:
    """Flies one try; an error is a result too, and is flown again by the next campaign in that folder."""
    for attempt in range(FLIGHTS):
        try:
            result = _flown(job, kept, minutes, attempt)
            break
        except (NoFlight, TimeoutError, OSError) as error:
            result = {"error": f"{type(error).__name__}: {error}"}
            if kept.ended.is_set():
                break
    result = {"row": job.row, "generation": job.generation, "try": job.number, **result}
    if not kept.ended.is_set():
        kept.add(result)
    return result


def _flown(job: Job, kept: Kept, minutes: float, attempt: int) -> dict[str, Any]:
    row = ROWS[job.row]
    rng = random.Random(f"{SEED} {job.row} {job.generation} {job.number} {attempt}")
    home = Path(tempfile.mkdtemp(prefix="musselbed-safety-"))
    try:
        with ExitStack() as stack:
            flight = Flight(home, job.generation, rng, row.setup, stack, 60 * minutes + LONGER_S, kept.ended)
            flight.begin()
            flight.pause(rng.uniform(0.0, 3.0))
            case = row.act(Try(flight, job.number, minutes))
            verdict = judge(flight.look(), case)
            despite = flight.despite
        if verdict.failures:
            _keep(home, kept.folder / "failed" / job.name)
        return asdict(verdict) | {"despite": despite}
    except (NoFlight, TimeoutError, OSError):
        _keep(home, kept.folder / "not-begun" / job.name)
        raise
    finally:
        shutil.rmtree(home, ignore_errors=True)


def _keep(home: Path, target: Path) -> None:
    """Keeps the output of the wire, the bench and the vehicle's programs, which shows the cause of a failure."""
    target.mkdir(parents=True, exist_ok=True)
    for path in (it for pattern in KEPT for it in home.glob(pattern)):
        shutil.copy(path, target)
