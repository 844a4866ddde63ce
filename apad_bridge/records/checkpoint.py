"""checkpoint.jsonl: everything a supervisor has learned about its aMussels, so that its successor believes the same.

The file's first line is a full record of all beliefs. An update follows for each tick in which something was learned. After
many updates a new file with a full record replaces the old one atomically, so that the file stays small in a long run
and is read within seconds. The file is written from beliefs and read into beliefs, and holds no truth. It also holds the
counts of what was dropped. The end of a run deletes it.
"""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from errno import EMFILE, ENFILE
from pathlib import Path
from typing import Any, Protocol

from apad_bridge.beliefs.fleet_beliefs import FleetBeliefs
from apad_bridge.beliefs.measurement import Measurement, measurement_of, measurement_row
from apad_bridge.records.line_file import LineFile, read_lines

FORMAT = 5
ROWS = 10_000
PERIOD_MS = 600_000
"""A full record is due after so many rows, or so much mission time: a resumed supervisor replays no more than that."""
_FORGOT = "forgot"
_ADMITTED = "admitted"


class CheckpointedState(Protocol):
    """State that is checkpointed beside the beliefs: that of the RangingService."""

    def full_state(self) -> dict[str, Any]:
        """The full state, as plain data."""

    def updates(self) -> dict[str, Any] | None:
        """The changes since the last call of `full_state` or `updates`, as plain data; None if there are none."""

    def restore(self, state: dict[str, Any]) -> None: ...

    def apply_updates(self, updates: dict[str, Any]) -> None: ...


class Checkpoint:
    """Writes the checkpoint file of `beliefs` from now on.

    Updates reach the file at `flush`, which is called at the end of every tick.
    """

    def __init__(
        self,
        path: Path,
        beliefs: FleetBeliefs,
        now_ms: int,
        ranging: CheckpointedState | None = None,
        counts: Callable[[], Counter[str]] = Counter,
    ) -> None:
        """Writes a full record at mission time `now_ms`, which replaces a checkpoint file that was there.

        `counts` returns how much was dropped so far, by reason.
        """
        self._path = path
        self._beliefs = beliefs
        self._ranging = ranging
        self._counts = counts
        self._rows: list[list[Any]] = []
        self._rows_in_file = 0
        self._full_record_ms = now_ms
        self._written_counts: Counter[str] = Counter()
        self._file = self._write_full_record(now_ms)
        beliefs.belief_log = self

    def learned(self, agent_id: int, measurement: Measurement, at_ms: int) -> None:
        self._rows.append(measurement_row(agent_id, measurement, at_ms))

    def forgot(self, agent_id: int) -> None:
        self._rows.append([_FORGOT, agent_id])

    def admitted(self, agent_id: int, kept: dict[str, Any]) -> None:
        self._rows.append([_ADMITTED, agent_id, kept])

    def flush(self, now_ms: int) -> None:
        """Writes an update if anything was learned since the last call, or a full record if one is due."""
        rows, self._rows = self._rows, []
        updates = None if self._ranging is None else self._ranging.updates()
        counts = self._counts()
        counts_changed = counts != self._written_counts
        if not rows and updates is None and not counts_changed:
            return
        self._rows_in_file += len(rows) + (updates is not None) + counts_changed
        is_due = self._rows_in_file > ROWS or now_ms >= self._full_record_ms + PERIOD_MS
        if is_due and self._renew(now_ms):
            return
        extra = ({} if updates is None else {"ranging": updates}) | (
            {"counts": counts} if counts_changed else {}
        )
        self._written_counts = counts
        self._file.append({"t": now_ms, "learned": rows} | extra)
        self._file.flush()

    def close(self) -> None:
        """Leaves the file as it is; a second call does nothing."""
        self._beliefs.belief_log = None
        self._file.close()

    def _renew(self, now_ms: int) -> bool:
        """False where no descriptor is free, as while strangers hold all: the file goes on, and a full record stays due."""
        try:
            fresh = self._write_full_record(now_ms)
        except OSError as error:
            if error.errno not in (EMFILE, ENFILE):
                raise
            return False
        self._file.close()
        self._file = fresh
        return True

    def _write_full_record(self, now_ms: int) -> LineFile:
        fresh = self._path.with_name(f".{self._path.name}.fresh")
        fresh.unlink(missing_ok=True)
        file = LineFile(fresh)
        ranging = None if self._ranging is None else self._ranging.full_state()
        self._written_counts = self._counts()
        state = {"beliefs": self._beliefs.kept(), "ranging": ranging, "counts": self._written_counts}
        file.append({"t": now_ms, "format": FORMAT} | state)
        file.flush()
        file.sync()  # a power cut after the renaming leaves the old record or this one
        os.replace(fresh, self._path)
        self._full_record_ms, self._rows_in_file = now_ms, 0
        return file


@dataclass(frozen=True, slots=True)
class Restored:
    """The result of `restore`: the state as of mission time `until_ms`, from so many `rows` after the full record.

    `whole` is False when the file is torn or damaged after that time.
    """

    until_ms: int
    rows: int
    whole: bool
    counts: Counter[str] | None
    """Counts of what was dropped, by reason; None from a file of a version without these counts."""


class NoCheckpoint(Exception):
    """The checkpoint cannot be read; the message is one line with the reason."""


def restore(path: Path, beliefs: FleetBeliefs, ranging: CheckpointedState | None = None) -> Restored:
    """Restores the former supervisor's `beliefs` and `ranging`. NoCheckpoint when the file cannot be read at all."""
    try:
        lines = read_lines(path)
        first = next(lines, None)
        if first is None or first.get("format") != FORMAT:
            raise NoCheckpoint(f"{path.name} is of another version, or damaged")
        beliefs.restore(first["beliefs"])
        if ranging is not None:
            ranging.restore(first["ranging"])
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
        try:
            for row in line["learned"]:
                _learn(beliefs, row)
            if ranging is not None and "ranging" in line:
                ranging.apply_updates(line["ranging"])
            if "counts" in line:
                counts = Counter(line["counts"])
            rows, until_ms = rows + len(line["learned"]), line["t"]
        except (AttributeError, IndexError, KeyError, TypeError, ValueError):
            return Restored(until_ms, rows, whole=False, counts=counts)
    return Restored(until_ms, rows, whole=True, counts=counts)


def _learn(beliefs: FleetBeliefs, row: list[Any]) -> None:
    if row[0] == _FORGOT:
        beliefs.forget(row[1])
    elif row[0] == _ADMITTED:
        beliefs.admit(row[1], beliefs.estimator.restored(row[1], row[2]))
    else:
        beliefs.learn(*measurement_of(row))
