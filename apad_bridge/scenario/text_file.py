"""Reads a user's text file whole, and writes one whole or not at all. A device, which would never end, is refused."""

from __future__ import annotations

import errno
import os
import tempfile
from pathlib import Path


def read_text(path: Path, encoding: str = "utf-8") -> str:
    """The file's text. OSError, also for a device; UnicodeDecodeError. A pipe, as `<(command)` gives it, is read."""
    if path.is_char_device() or path.is_block_device():
        raise OSError(errno.EINVAL, "is a device, and not a file", str(path))
    return path.read_text(encoding=encoding)


def write_atomically(path: Path, text: str) -> None:
    """Writes a text file under a temporary name in the same directory, then renames it."""
    descriptor, temporary = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
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
