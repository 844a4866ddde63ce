"""checkpoint.jsonl: what a supervisor has learned of its aMussels, so that the next one believes the same if it dies.

The first line is a checkpoint of all beliefs; a line for each tick follows, with what was learned in it. When those have
become many, a new checkpoint takes the file's place at once: it stays small however long a run is, and is read in seconds.
It is written by beliefs and read into beliefs, and knows no truth. A run that ends takes it away. Beside what was learned
stand the counts of what came to nothing.
"""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

from apad_bridge.beliefs.fleet import FleetBeliefs
from apad_bridge.beliefs.measurement import Measurement
from apad_bridge.beliefs.measurement_lines import measurement_of, measurement_row
from apad_bridge.records.line_file import LineFile, read_lines

FORMAT = 2
ROWS = 10_000
PERIOD_MS = 600_000
"""A checkpoint is due after so many rows, or so much mission time: what a resumed supervisor replays at most."""
_FORGOT = "forgot"
_ADMITTED = "admitted"


class Remembers(Protocol):
    """Somebody else who learns: the aPad's ears."""

    def kept(self) -> dict[str, Any]:
        """All of it, as plain data."""
        ...

    def news(self) -> dict[str, Any] | None:
        """What came since `kept` or `news` was asked last; None for nothing."""
        ...

    def restore(self, kept: dict[str, Any]) -> None: ...

    def take_news(self, news: dict[str, Any]) -> None: ...


class Checkpoint:
    """The diary of `beliefs`, from now on. Rows reach the file at `flush`, which is called at the end of every tick."""

    def __init__(
        self,
        path: Path,
        beliefs: FleetBeliefs,
        now_ms: int,
        ranging: Remembers | None = None,
        counts: Callable[[], Counter[str]] = Counter,
    ) -> None:
        """Begins with a checkpoint at mission time `now_ms`, which takes the place of a notebook that was there.

        `counts` says what came to nothing so far, by reason.
        """
        self._path = path
        self._beliefs = beliefs
        self._ranging = ranging
        self._counts = counts
        self._rows: list[list[Any]] = []
        self._rows_in_file = 0
        self._begun_ms = now_ms
        self._told_counts: Counter[str] = Counter()
        self._file = self._begun(now_ms)
        beliefs.diary = self

    def learned(self, agent_id: int, measurement: Measurement) -> None:
        self._rows.append(measurement_row(agent_id, measurement))

    def forgot(self, agent_id: int) -> None:
        self._rows.append([_FORGOT, agent_id])

    def admitted(self, agent_id: int, kept: dict[str, Any]) -> None:
        self._rows.append([_ADMITTED, agent_id, kept])

    def flush(self, now_ms: int) -> None:
        rows, self._rows = self._rows, []
        news = None if self._ranging is None else self._ranging.news()
        counts = self._counts()
        counted = counts != self._told_counts
        if not rows and news is None and not counted:
            return
        self._rows_in_file += len(rows) + (news is not None) + counted
        if self._rows_in_file > ROWS or now_ms >= self._begun_ms + PERIOD_MS:
            self._file.close()
            self._file = self._begun(now_ms)
            return
        more = ({} if news is None else {"ears": news}) | ({"counts": counts} if counted else {})
        self._told_counts = counts
        self._file.append({"t": now_ms, "learned": rows} | more)
        self._file.flush()

    def close(self) -> None:
        """Leaves the file as it is; a second call does nothing."""
        self._beliefs.diary = None
        self._file.close()

    def _begun(self, now_ms: int) -> LineFile:
        fresh = self._path.with_name(f".{self._path.name}.fresh")
        fresh.unlink(missing_ok=True)
        file = LineFile(fresh)
        ranging = None if self._ranging is None else self._ranging.kept()
        self._told_counts = self._counts()
        kept = {"beliefs": self._beliefs.kept(), "ears": ranging, "counts": self._told_counts}
        file.append({"t": now_ms, "format": FORMAT} | kept)
        file.flush()
        os.replace(fresh, self._path)
        self._begun_ms, self._rows_in_file = now_ms, 0
        return file


@dataclass(frozen=True, slots=True)
class Restored:
    """What a notebook gave: as of mission time `until_ms`, by so many rows after its checkpoint.

    `whole` is False when it is torn or damaged after that.
    """

    until_ms: int
    rows: int
    whole: bool
    counts: Counter[str] | None
    """Of what came to nothing; None in a notebook of a version that did not keep them."""


class NoCheckpoint(Exception):
    """One line: why there is nothing to be recalled."""


def restore(path: Path, beliefs: FleetBeliefs, ranging: Remembers | None = None) -> Restored:
    """Believes and remembers what the notebook's supervisor did; NoCheckpoint when it cannot be read at all."""
    try:
        lines = read_lines(path)
        first = next(lines, None)
        if first is None or first.get("format") != FORMAT:
            raise NoCheckpoint(f"{path.name} is of another version, or damaged")
        beliefs.restore(first["beliefs"])
        if ranging is not None:
            ranging.restore(first["ears"])
        until_ms: int = first["t"]
        counts: Counter[str] | None = Counter(first["counts"]) if "counts" in first else None
    except OSError as error:
        raise NoCheckpoint(f"{path.name}: {error.strerror}") from error
    except (KeyError, TypeError, ValueError) as error:
        raise NoCheckpoint(f"{path.name} is of another version, or damaged ({error})") from error
    rows = 0
    for line in lines:
        if line is None:
            return Restored(until_ms, rows, whole=False, counts=counts)
        for row in line["learned"]:
            _learn(beliefs, row)
        if ranging is not None and "ears" in line:
            ranging.take_news(line["ears"])
        if "counts" in line:
            counts = Counter(line["counts"])
        rows, until_ms = rows + len(line["learned"]), line["t"]
    return Restored(until_ms, rows, whole=True, counts=counts)


def _learn(beliefs: FleetBeliefs, row: list[Any]) -> None:
    if row[0] == _FORGOT:
        beliefs.forget(row[1])
    elif row[0] == _ADMITTED:
        beliefs.admit(row[1], beliefs.estimator.restored(row[1], row[2]))
    else:
        beliefs.learn(*measurement_of(row))
