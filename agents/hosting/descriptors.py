"""A process's open files: the highest limit that it may have, and a few descriptors in reserve.

A server that has no descriptor left cannot accept a connection, not even that of a person who orders a stop. A reserve is
given up for such a connection and taken again afterwards.
"""

from __future__ import annotations

import errno
import os
import resource
from contextlib import suppress

SHORT_OF_FILES = frozenset({errno.EMFILE, errno.ENFILE})
"""The errors of a process, or a machine, that may open no further file."""
_RESERVED = 8


def raise_descriptor_limit() -> int:
    """Raises this process's limit of descriptors to the highest allowed. Returns it."""
    _, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (hard, hard))
    return hard


class Reserve:
    """Descriptors that are held open for nothing else. For one thread."""

    def __init__(self) -> None:
        self._held: list[int] = []
        self.refill()

    def give_up_one(self) -> bool:
        """Closes one of them, so that the next file can be opened. False when none is left."""
        if not self._held:
            return False
        os.close(self._held.pop())
        return True

    def refill(self) -> None:
        """Takes as many again as there are to be, as far as the process may open files now."""
        with suppress(OSError):
            while len(self._held) < _RESERVED:
                self._held.append(os.open(os.devnull, os.O_RDONLY | os.O_CLOEXEC))

    def close(self) -> None:
        while self.give_up_one():
            pass
