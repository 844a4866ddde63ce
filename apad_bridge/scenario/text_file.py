"""Reads a user's text file whole, and writes one whole or not at all.

A device, which would never end, is refused, and so is a pipe into which nobody writes.
"""

from __future__ import annotations

import errno
import os
import select
import tempfile
from pathlib import Path

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


def write_atomically(path: Path, text: str) -> None:
    """Writes a text file under a temporary name in the same directory, then renames it. OSError with the file's name."""
    try:
        descriptor, temporary = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
    except OSError as error:
        error.filename = str(path)
        raise
    try:
        with open(descriptor, "w", encoding="utf-8", newline="\n") as file:
            os.fchmod(descriptor, 0o644)
            file.write(text)
            file.flush()
            os.fsync(descriptor)
        os.replace(temporary, path)
    except BaseException:
        os.unlink(temporary)
        raise
