"""journal.jsonl: the authoritative record of a run. One JSON object a line, `{"t": mission ms, "kind": ..., ...}`.

It holds events, not samples. `t` never falls from one line to the next. Lines wait for the end of their tick and are then
sorted: an aMussel's events between two ticks are known at the second tick, one aMussel after the other. (Journals of
versions up to 0.1 were not sorted.)
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

from agents.time_scale import MissionMs
from apad_bridge.events.event import Event
from apad_bridge.events.run import RunBegan
from apad_bridge.records.line_file import Line, LineFile, LineTail, numbered_lines, read_lines
from apad_bridge.records.line_types import fault_of
from apad_bridge.records.run_directory import RunDirectory, RunDirectoryError

__all__ = [
    "FORMAT_VERSION",
    "Journal",
    "JournalContents",
    "JournalDamaged",
    "JournalTail",
    "Line",
    "await_beginning",
    "format_of",
    "read_journal",
]

Kind = TypeVar("Kind", bound=Event)
FORMAT_VERSION = 2
_BEGINS_S = 30.0
"""Wall seconds: agents, a master and an aPad start before the first line is written."""
_LOOK_S = 0.1
_QUIET_TICK = b',"kind":"tick"}\n'


class JournalDamaged(RunDirectoryError):
    """A line lacks a field of its kind, or has a wrong one; the message names the file and the line's number."""


@dataclass(frozen=True, slots=True)
class JournalContents:
    lines: list[Line]
    dropped: int
    """Lines that could not be read: a torn last one after a kill, or damage."""

    @property
    def last_ms(self) -> MissionMs:
        """The newest mission time that a line names; 0 for an empty journal."""
        return MissionMs(max((line["t"] for line in self.lines), default=0))

    def events(self, *kinds: type[Kind]) -> Iterator[tuple[MissionMs, Kind]]:
        """The events of these classes, each with its mission time, in the journal's order."""
        wanted = {it.kind: it for it in kinds}
        for line in self.lines:
            if (kind := wanted.get(line["kind"])) is not None:
                yield MissionMs(line["t"]), kind.of(line)

    def first(self, kind: str) -> Line | None:
        return next((line for line in self.lines if line["kind"] == kind), None)


class Journal:
    """Appends to the journal. Lines reach the file at `flush`, at the end of every tick, sorted and all in one write."""

    def __init__(self, path: Path, flushed_ms: int = 0) -> None:
        """Opens the file at its end and creates it if needed; cuts off a torn last line.

        `flushed_ms` is the newest mission time in the file.
        """
        self._file = LineFile(path)
        self.last_ms = -1
        """The newest mission time of an appended line; -1 for none."""
        self.flushed_ms = flushed_ms
        """The newest mission time in the file; 0 for none."""

    @property
    def torn_bytes(self) -> int:
        """The length of the torn last line that was cut off."""
        return self._file.torn_bytes

    def append(self, at_ms: int, event: Event) -> None:
        """Appends the line of an event at mission time `at_ms`.

        ValueError for a value that the event's class does not allow, for one that JSON lacks (NaN), and for a time before a
        line that is in the file; TypeError for data that is not plain.
        """
        data = event.data
        if (fault := fault_of(event.kind, data)) is not None:
            raise ValueError(f"{fault}: {data!r}")
        if at_ms < self.flushed_ms:
            raise ValueError(
                f"time went back: a line {event.kind!r} of {at_ms} ms after one of {self.flushed_ms} ms"
            )
        self._file.append({"t": at_ms, "kind": event.kind, **data}, at_ms)
        self.last_ms = max(self.last_ms, at_ms)

    def refuse_gone(self) -> None:
        """FileGone when the journal was deleted or moved, with its directory or alone."""
        self._file.refuse_gone()

    def flush(self) -> None:
        self._file.flush()
        self.flushed_ms = max(self.flushed_ms, self.last_ms)

    def close(self) -> None:
        """Flushes; a second call does nothing."""
        self._file.close()


def read_journal(path: Path) -> JournalContents:
    """Reads all lines; of quiet ticks in a row only the last.

    OSError for no file; JournalDamaged for a line of a known kind without its fields. Further fields, and kinds of another
    version, are left as they are.
    """
    reader = _LineReader(path)
    for number, line in numbered_lines(path, newest_of=_QUIET_TICK):
        reader.take(number, line)
    return JournalContents(reader.lines, reader.dropped)


class JournalTail:
    """Reads a journal that grows: each `read_new` gives the lines that were written since the last one."""

    def __init__(self, path: Path) -> None:
        """OSError for no file."""
        self._tail = LineTail(path)
        self._reader = _LineReader(path)

    def read_new(self) -> JournalContents:
        """The new whole lines, as `read_journal` gives them. A line whose end is not written yet comes later."""
        self._reader.lines, self._reader.dropped = [], 0
        for number, line in self._tail.read_new():
            self._reader.take(number, line)
        return JournalContents(self._reader.lines, self._reader.dropped)

    def close(self) -> None:
        self._tail.close()


def await_beginning(
    directory: RunDirectory, is_asked_to_end: Callable[[], bool], tell: Callable[[str], None]
) -> bool:
    """Waits until a run that is starting has written the first line of its journal; False when asked to end before.

    It returns at once for a directory without a scenario, and for that of several aPads. After `_BEGINS_S` it tells a
    person once that it still waits: somebody else's master, or a large fleet, may need longer.
    """
    told_s = time.monotonic() + _BEGINS_S
    while directory.scenario.is_file() and not (
        directory.journal.is_file() and directory.journal.stat().st_size
    ):
        if is_asked_to_end():
            return False
        if any(directory.path.glob("*/journal.jsonl")):
            break
        if time.monotonic() > told_s:
            told_s = math.inf
            tell(f"no flight began in {directory.path} within {_BEGINS_S:g} s; still waiting for it")
        time.sleep(_LOOK_S)
    return True


class _LineReader:
    """Takes the lines of a journal in order, and checks them."""

    def __init__(self, path: Path) -> None:
        self.lines: list[Line] = []
        self.dropped = 0
        self._path = path

    def take(self, number: int, line: Line | None) -> None:
        if line is None or type(line.get("t")) is not int or type(line.get("kind")) is not str:
            self.dropped += 1
            return
        if (fault := fault_of(line["kind"], line)) is not None:
            raise JournalDamaged(
                f"{self._path}, line {number}: {fault}: damaged, or of another version: mend or remove the line, or use "
                "the version that flew the run (versions.json beside it)"
            )
        self.lines.append(line)


def format_of(path: Path) -> int | None:
    """The format that a journal's first line states, or None. OSError for no such file."""
    first = next(iter(read_lines(path)), None)
    return None if first is None or first.get("kind") != RunBegan.kind else first.get("format")
