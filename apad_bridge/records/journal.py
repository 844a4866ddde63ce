"""journal.jsonl: what a run IS. One JSON object a line, `{"t": mission ms, "kind": ..., ...}`; events, not samples.

Lines stand in the order in which things became known, which is not strictly that of `t`: what an aMussel did between two
ticks is known at the second one.
"""

from __future__ import annotations

import json
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

FORMAT_VERSION = 1

Line = dict[str, Any]

_encode = json.JSONEncoder(separators=(",", ":"), allow_nan=False).encode


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
        self._descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_APPEND | os.O_CLOEXEC, 0o644)
        self._waiting: list[str] = []
        self.last_ms = -1
        """The newest mission time that was appended; -1 for none."""
        self.torn_bytes = _cut_torn_line(self._descriptor)

    def append(self, at_ms: int, kind: str, data: Line) -> None:
        """ValueError for a value that JSON does not have (NaN); TypeError for one that is not plain data."""
        self._waiting.append(_encode({"t": at_ms, "kind": kind, **data}))
        self.last_ms = max(self.last_ms, at_ms)

    def flush(self) -> None:
        if not self._waiting:
            return
        data = memoryview(("\n".join(self._waiting) + "\n").encode())
        self._waiting.clear()
        while data:
            data = data[os.write(self._descriptor, data) :]

    def close(self) -> None:
        """Flushes; a second call does nothing."""
        if self._descriptor >= 0:
            self.flush()
            os.close(self._descriptor)
            self._descriptor = -1


def read_journal(path: Path) -> JournalContents:
    """All lines that can be read, and how many could not. OSError when there is no such file."""
    lines: list[Line] = []
    dropped = 0
    with path.open("rb") as file:
        for raw in file:
            line = _decode(raw)
            if line is None:
                dropped += 1
            else:
                lines.append(line)
    return JournalContents(lines, dropped)


def _decode(raw: bytes) -> Line | None:
    if not raw.endswith(b"\n"):
        return None
    try:
        line = json.loads(raw)
    except ValueError:
        return None
    if not isinstance(line, dict) or type(line.get("t")) is not int or type(line.get("kind")) is not str:
        return None
    return line


def _cut_torn_line(descriptor: int) -> int:
    """Cuts what follows the last line's end; how many bytes that were. The next line would else be glued to it."""
    end = size = os.fstat(descriptor).st_size
    while end > 0:
        start = max(0, end - 65536)
        newline = os.pread(descriptor, end - start, start).rfind(b"\n")
        if newline >= 0:
            end = start + newline + 1
            break
        end = start
    if end < size:
        os.ftruncate(descriptor, end)
    return size - end
