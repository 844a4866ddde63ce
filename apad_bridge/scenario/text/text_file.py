"""Reads a user's text file whole, and writes a file whole or not at all.

A device, which would never end, is refused, and so is a pipe into which nobody writes.
"""

from __future__ import annotations

import errno
import os
import select
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from apad_bridge.scenario.errors import ScenarioError

PIPE_S = 10.0
"""Wall seconds: a pipe that gives nothing for so long is refused."""


def read_text(path: Path, encoding: str = "utf-8") -> str:
    """The file's text. OSError, also for a device; UnicodeDecodeError. A pipe, as `<(command)` gives it, is read."""
    if path.is_char_device() or path.is_block_device():
        raise OSError(errno.EINVAL, "is a device, and not a file", str(path))
    return _read_pipe(path).decode(encoding) if path.is_fifo() else path.read_text(encoding=encoding)


def _read_pipe(path: Path) -> bytes:
    """Opened so that it waits for no writer: plain `open` waits for ever."""
    pieces: list[bytes] = []
    descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK)
    try:
        poll = select.poll()
        poll.register(descriptor, select.POLLIN)
        while poll.poll(1000 * PIPE_S):  # also at the end, when its last writer has gone
            if not (piece := os.read(descriptor, 65_536)):
                return b"".join(pieces)
            pieces.append(piece)
    finally:
        os.close(descriptor)
    raise OSError(errno.ETIMEDOUT, f"is a pipe, and nobody writes into it within {PIPE_S:g} s", str(path))


def text_of(path: Path, encoding: str = "utf-8") -> str:
    """The file's text; ScenarioError, one line, for one that cannot be read."""
    try:
        return read_text(path, encoding)
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "is not UTF-8 text"
        raise ScenarioError([f"{path}: {reason}"]) from error


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """A new file beside `path`, which takes its place when this is left without an error. OSError names `path`."""
    try:
        descriptor, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
    except OSError as error:
        error.filename = str(path)
        raise
    try:
        os.fchmod(descriptor, 0o644)
        os.close(descriptor)
        yield Path(name)
        os.replace(name, path)
    except BaseException:
        os.unlink(name)
        raise


def write_atomically(path: Path, text: str) -> None:
    """Writes a text file whole or not at all, and to the disk."""
    with replacing(path) as fresh, fresh.open("w", encoding="utf-8", newline="\n") as file:
        file.write(text)
        file.flush()
        os.fsync(file.fileno())
