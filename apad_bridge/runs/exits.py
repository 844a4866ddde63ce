"""The exit codes of all commands, and their meaning."""

from __future__ import annotations

from enum import IntEnum


class Exit(IntEnum):
    DONE = 0
    BUG = 1
    USER_MISTAKE = 2
    PEER_FAILED = 3
    INTERRUPTED = 130


EXITS = (
    "0 done, 1 a bug of ours (with its traceback), 2 a mistake in what was asked (one line with the mend), "
    "3 something that was needed failed or fell silent, 130 ended by Ctrl-C, with its records whole"
)


class UserError(Exception):
    """A mistake of the user's: the text is one clear line, with the mend."""
