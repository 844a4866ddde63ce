"""Reads a user's text file whole; a device, which would never end, is refused."""

from __future__ import annotations

import errno
from pathlib import Path


def read_text(path: Path, encoding: str = "utf-8") -> str:
    """The file's text. OSError, also for a device; UnicodeDecodeError. A pipe, as `<(command)` gives it, is read."""
    if path.is_char_device() or path.is_block_device():
        raise OSError(errno.EINVAL, "is a device, and not a file", str(path))
    return path.read_text(encoding=encoding)
