"""journal.jsonl: what a run IS. One JSON object a line, `{"t": mission ms, "kind": ..., ...}`; events, not samples.

Lines stand in the order in which things became known, which is not strictly that of `t`: what an aMussel did between two
ticks is known at the second one.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from apad_bridge.records.line_file import Line, LineFile, read_lines

__all__ = ["FORMAT_VERSION", "Journal", "JournalContents", "Line", "format_of", "read_journal"]

FORMAT_VERSION = 2
_RENAMED_IN_2 = {
    "apad": {"slots": "docks"},
    "dock": {"slot": "dock"},
    "packet": {"slot": "timeslot"},
    "primitive": {"slot": "dock"},
}
"""By kind of line: what a key of format 1 is called since."""
_QUIET = b',"kind":"tick"}\n'


@dataclass(frozen=True, slots=True)
class JournalContents:
    lines: list[Line]
    dropped: int
    """Lines that could not be read: a torn last one after a kill, or damage."""

    @property
    def last_ms(self) -> int:
        """The newest mission time that a line names; 0 for an empty journal."""
        return max((line["t"] for line in self.lines), default=0)

    def first(self, kind: str) -> Line | None:
        return next((line for line in self.lines if line["kind"] == kind), None)


class Journal:
    """Append-only. Lines reach the file at `flush`, which is called at the end of every tick, all in one write."""

    def __init__(self, path: Path) -> None:
        """Opens the file at its end, making it if there is none; a torn last line is cut off."""
        self._file = LineFile(path)
        self.last_ms = -1
        """The newest mission time that was appended; -1 for none."""

    @property
    def torn_bytes(self) -> int:
        """How long the torn last line was that was found."""
        return self._file.torn_bytes

    def append(self, at_ms: int, kind: str, data: Line) -> None:
        """ValueError for a value that JSON does not have (NaN); TypeError for one that is not plain data."""
        self._file.append({"t": at_ms, "kind": kind, **data})
        self.last_ms = max(self.last_ms, at_ms)

    def flush(self) -> None:
        self._file.flush()

    def close(self) -> None:
        """Flushes; a second call does nothing."""
        self._file.close()


def read_journal(path: Path) -> JournalContents:
    """Reads all lines, with the keys of today's format; keeps the last of quiet ticks in a row. OSError for no file."""
    lines: list[Line] = []
    dropped, is_old = 0, False
    for line in read_lines(path, newest_of=_QUIET):
        if line is None or type(line.get("t")) is not int or type(line.get("kind")) is not str:
            dropped += 1
        else:
            is_old = is_old or (line["kind"] == "run" and line.get("format") == 1)
            lines.append(_of_format_2(line) if is_old else line)
    return JournalContents(lines, dropped)


def format_of(path: Path) -> int | None:
    """The format that a journal's first line states; None when that states none. OSError for no such file."""
    first = next(iter(read_lines(path)), None)
    return None if first is None or first.get("kind") != "run" else first.get("format")


def _of_format_2(line: Line) -> Line:
    """A line of format 1 with the keys that format 2 has for it; its `run` line keeps the old number."""
    if line["kind"] == "plan":
        return line | {"steps": [_renamed(step, {"slot": "dock"}) for step in line["steps"]]}
    return _renamed(line, _RENAMED_IN_2.get(line["kind"], {}))


def _renamed(line: Line, names: Mapping[str, str]) -> Line:
    return {names.get(key, key): value for key, value in line.items()}
