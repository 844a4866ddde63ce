"""A growing file of JSON objects, one a line. A kill can tear only the last line."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from pydantic_core import from_json

Line = dict[str, Any]

_encode = json.JSONEncoder(separators=(",", ":"), allow_nan=False).encode


class FileGone(OSError):
    """A file that is being written has no longer its name: it was deleted, moved or replaced. The text says which."""


class LineFile:
    """Appends lines to a file; they reach it at `flush`. It belongs to one writer alone."""

    def __init__(self, path: Path) -> None:
        """Opens the file at its end and creates it if needed; cuts off a torn last line."""
        self._descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_APPEND | os.O_CLOEXEC, 0o644)
        self._path = path
        self._identity = _identity(path)
        self._waiting: list[tuple[int, str]] = []
        self.torn_bytes = _cut_torn_line(self._descriptor)

    def append(self, line: Line, at_ms: int = 0) -> None:
        """Appends a line. ValueError for a value that JSON lacks (NaN); TypeError for data that is not plain."""
        self._waiting.append((at_ms, _encode(line)))

    def flush(self) -> None:
        """Writes the waiting lines by their `at_ms`; of the same time, as they were appended.

        OSError when the file cannot take the lines: none of them is then in it.
        """
        if not self._waiting:
            return
        self._waiting.sort(key=lambda entry: entry[0])
        data = memoryview("".join(f"{text}\n" for _, text in self._waiting).encode())
        self._waiting.clear()
        written = 0
        try:
            while written < len(data):
                written += os.write(self._descriptor, data[written:])
        except OSError:
            os.ftruncate(self._descriptor, os.fstat(self._descriptor).st_size - written)
            raise

    def refuse_gone(self) -> None:
        """FileGone when the file's path does not lead to it any more: lines would go where nobody looks for them."""
        if _identity(self._path) == self._identity:
            return
        now = os.readlink(f"/proc/self/fd/{self._descriptor}")
        is_deleted = os.fstat(self._descriptor).st_nlink == 0
        raise FileGone(f"{self._path} was {'deleted' if is_deleted else f'moved to {now}'}")

    def sync(self) -> None:
        """Returns when what was flushed survives a power cut, and not just the death of this process."""
        os.fsync(self._descriptor)

    def close(self) -> None:
        """Flushes; a second call does nothing."""
        if self._descriptor >= 0:
            try:
                self.flush()
            finally:
                os.close(self._descriptor)
                self._descriptor = -1


def read_lines(path: Path) -> Iterator[Line | None]:
    """Yields each line in order; None for a line that is no whole JSON object. OSError when there is no such file."""
    return (line for _, line in numbered_lines(path))


def numbered_lines(path: Path, newest_of: bytes = b"") -> Iterator[tuple[int, Line | None]]:
    """Like `read_lines`, with the number of each line in the file, from 1.

    Of successive lines that end in `newest_of` it yields only the last; skipping the others costs next to nothing.
    """
    waiting, number = b"", 0
    with path.open("rb") as file:
        for number, raw in enumerate(file, 1):
            if newest_of and raw.endswith(newest_of):
                waiting = raw
                continue
            if waiting:
                yield number - 1, decoded(waiting)
                waiting = b""
            yield number, decoded(raw)
    if waiting:
        yield number, decoded(waiting)


class LineTail:
    """Reads a file that grows: each `read_new` gives the lines that were written since the last one, with their numbers."""

    def __init__(self, path: Path) -> None:
        """OSError for no file."""
        self._file = path.open("rb")
        self._number = 0

    def read_new(self) -> Iterator[tuple[int, Line | None]]:
        """The new whole lines; None for one that is no JSON object. A line whose end is not written yet comes later.

        It is then read again from its beginning, because the file's next writer may have cut it off.
        """
        *lines, torn = self._file.read().split(b"\n")
        self._file.seek(-len(torn), os.SEEK_CUR)
        for raw in lines:
            self._number += 1
            yield self._number, decoded(raw + b"\n")

    def close(self) -> None:
        self._file.close()


def decoded(raw: bytes) -> Line | None:
    """The JSON object of one line with its end; None for anything else."""
    if not raw.endswith(b"\n"):
        return None
    try:
        line = from_json(raw)
    except ValueError:
        try:
            line = json.loads(raw)  # slower, and takes half a surrogate pair, as a file's name may have
        except (ValueError, RecursionError):
            return None
    return line if isinstance(line, dict) else None


def _identity(path: Path) -> tuple[int, int] | None:
    """The file at this path, by its device and number; None for no file."""
    try:
        status = path.stat()
    except (FileNotFoundError, NotADirectoryError):
        return None
    return status.st_dev, status.st_ino


def _cut_torn_line(descriptor: int) -> int:
    """Cuts the bytes after the last line's end, to which the next line would be joined; returns their number."""
    end = size = os.fstat(descriptor).st_size
    while end > 0:
        start = max(0, end - 65536)
        if (newline := os.pread(descriptor, end - start, start).rfind(b"\n")) >= 0:
            end = start + newline + 1
            break
        end = start
    if end < size:
        os.ftruncate(descriptor, end)
    return size - end
