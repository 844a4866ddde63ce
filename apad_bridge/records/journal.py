"""journal.jsonl: the authoritative record of a run. One JSON object a line, `{"t": mission ms, "kind": ..., ...}`.

It holds events, not samples. `t` never falls from one line to the next. Lines wait for the end of their tick and are then
sorted: an aMussel's events between two ticks are known at the second tick, one aMussel after the other. Readers get an
`Entry` for each line, and never the line.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

from agents.time_scale import MissionMs
from apad_bridge.events.all_events import event_of
from apad_bridge.events.event import Event
from apad_bridge.events.run_events import RunBegan
from apad_bridge.records.field_types import fault_of
from apad_bridge.records.line_file import Line, LineFile, LineTail, numbered_lines, read_lines
from apad_bridge.records.run_directory import RunDirectory, RunDirectoryError

OfKind = TypeVar("OfKind", bound=Event)
FORMAT_VERSION = 2
_BEGINS_S = 30.0
"""Wall seconds: agents, a master and an aPad start before the first line is written."""
_LOOK_S = 0.1
_QUIET_TICK = b',"kind":"tick"}\n'


class JournalDamaged(RunDirectoryError):
    """A line lacks a field of its kind, or has a wrong one, or the journal is of a version before 0.1.0.

    The message names the file, and a wrong line's number.
    """


class Entry(NamedTuple):
    """An event and its mission time."""

    at_ms: MissionMs
    event: Event

    @property
    def line(self) -> dict[str, Any]:
        """Its line in the journal, which is also its form for programs of other languages."""
        return {"t": self.at_ms, "kind": self.event.kind, **self.event.data}


@dataclass(frozen=True, slots=True)
class JournalContents:
    """The events of the readable lines, each with its mission time, in the journal's order."""

    entries: list[Entry]
    dropped: int
    """Lines that could not be read: a torn last one after a kill, or damage."""

    @property
    def last_ms(self) -> MissionMs:
        """The newest mission time of an event; 0 for an empty journal."""
        return max((it.at_ms for it in self.entries), default=MissionMs(0))

    def events(self, *kinds: type[OfKind]) -> Iterator[tuple[MissionMs, OfKind]]:
        """The events of these classes, each with its mission time, in the journal's order."""
        for at_ms, event in self.entries:
            if isinstance(event, kinds):
                yield at_ms, event

    def until(self, at_ms: int) -> JournalContents:
        """The events up to a mission time."""
        return replace(self, entries=[it for it in self.entries if it.at_ms <= at_ms])


class Journal:
    """Appends to the journal. Lines reach the file at `flush`, at the end of every tick, sorted and all in one write."""

    def __init__(self, path: Path, flushed_ms: int = 0) -> None:
        """Opens the file at its end and creates it if needed; cuts off a torn last line.

        `flushed_ms` is the newest mission time in the file.
        """
        self._file = LineFile(path)
        self.last_ms = MissionMs(-1)
        """The newest mission time of an appended line; -1 for none."""
        self.flushed_ms = MissionMs(flushed_ms)
        """The newest mission time in the file; 0 for none."""

    @property
    def torn_bytes(self) -> int:
        """The length of the torn last line that was cut off."""
        return self._file.torn_bytes

    def append(self, at_ms: MissionMs, event: Event) -> None:
        """Appends the line of an event at mission time `at_ms`.

        ValueError for a value that the event's class does not allow, for one that JSON lacks (NaN), and for a time before a
        line that is in the file; TypeError for data that is not plain.
        """
        line = Entry(at_ms, event).line
        if (fault := fault_of(event.kind, line)) is not None:
            raise ValueError(f"{fault}: {event.data!r}")
        if at_ms < self.flushed_ms:
            raise ValueError(
                f"time went back: a line {event.kind!r} of {at_ms} ms after one of {self.flushed_ms} ms"
            )
        self._file.append(line, at_ms)
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

    OSError for no file; JournalDamaged. A kind of another version is an `UnknownEvent`; further fields are left out.
    """
    reader = _LineReader(path)
    for number, line in numbered_lines(path, newest_of=_QUIET_TICK):
        reader.take(number, line)
    return JournalContents(reader.entries, reader.dropped)


class JournalTail:
    """Reads a journal that grows: each `read_new` gives the events that were written since the last one."""

    def __init__(self, path: Path) -> None:
        """OSError for no file."""
        self._tail = LineTail(path)
        self._reader = _LineReader(path)

    def read_new(self) -> JournalContents:
        """The events of new whole lines, as `read_journal` gives them. A line whose end is not written yet comes later."""
        self._reader.entries, self._reader.dropped = [], 0
        for number, line in self._tail.read_new():
            self._reader.take(number, line)
        return JournalContents(self._reader.entries, self._reader.dropped)

    def close(self) -> None:
        self._tail.close()


def await_beginning(
    directory: RunDirectory, is_asked_to_end: Callable[[], bool], tell: Callable[[str], None]
) -> bool:
    """Waits until a run that is starting has written the first line of its journal; False when asked to end before.

    It returns at once for a directory without a scenario, and for that of several aPads. After `_BEGINS_S` it tells a
    person once that it still waits: somebody else's master, or a large fleet, may need longer.
    """
    warns_s = time.monotonic() + _BEGINS_S
    while directory.scenario.is_file() and not (
        directory.journal.is_file() and directory.journal.stat().st_size
    ):
        if is_asked_to_end():
            return False
        if any(directory.path.glob("*/journal.jsonl")):
            break
        if time.monotonic() > warns_s:
            warns_s = math.inf
            tell(f"no flight began in {directory.path} within {_BEGINS_S:g} s; still waiting for it")
        time.sleep(_LOOK_S)
    return True


class _LineReader:
    """Takes the lines of a journal in order, and checks them."""

    def __init__(self, path: Path) -> None:
        self.entries: list[Entry] = []
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
        event = event_of(line["kind"], line)
        if isinstance(event, RunBegan) and event.format < FORMAT_VERSION:
            raise JournalDamaged(
                f"{self._path} is of a version before 0.1.0 (format {event.format}), which this one does not read: "
                "use the version that flew the run (versions.json beside it)"
            )
        self.entries.append(Entry(MissionMs(line["t"]), event))


def format_of(path: Path) -> int | None:
    """The format that a journal's first line states, or None. OSError for no such file."""
    first = next(iter(read_lines(path)), None)
    return None if first is None or first.get("kind") != RunBegan.kind else first.get("format")
