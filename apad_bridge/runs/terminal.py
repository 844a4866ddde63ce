"""Text for people on its way to a terminal: control characters of others are shown, and not obeyed.

Texts come from strategies, scripts, boards, ROS nodes and strangers' records. A terminal would obey an escape sequence in
them, which moves the cursor, writes over other lines or sets its title. The command's stdout and stderr go through here.

A stderr that takes no more text, as with `musselbed run ... 2>&1 | head` or on a full disk, is as a terminal that hangs
up: a flight ends in order, with complete records. Such a stdout makes the result worthless, so the command fails.
"""

from __future__ import annotations

import os
import signal
import sys
from typing import Any, TextIO, cast

from firmware_model.control_characters import shown


class PlainStream:
    """A stream that shows control characters; all else is as of the stream behind it."""

    def __init__(self, stream: TextIO) -> None:
        self.behind = stream
        """A console of ours (`rich_console.py`) writes its own control characters there."""

    def write(self, text: str) -> int:
        self.behind.write(shown(text))
        return len(text)

    def writelines(self, lines: list[str]) -> None:
        self.behind.writelines(map(shown, lines))

    def __getattr__(self, name: str) -> Any:
        return getattr(self.behind, name)


class HangingUp:
    """A stream that raises nothing. Once it can take no text, it drops all of it, and asks this process to end."""

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream

    def write(self, text: str) -> int:
        try:
            self._stream.write(text)
        except OSError:
            self._hang_up()
        return len(text)

    def flush(self) -> None:
        try:
            self._stream.flush()
        except OSError:
            self._hang_up()

    def _hang_up(self) -> None:
        discard(self._stream)
        signal.raise_signal(signal.SIGHUP)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)


def discard(stream: TextIO) -> None:
    """Lets the interpreter's own flush at its exit succeed: what could not be written once is not tried again."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())


def show_control_characters() -> None:
    """From now on this process's stdout and stderr show them."""
    behind = sys.stdout, cast(TextIO, HangingUp(sys.stderr))
    sys.stdout, sys.stderr = (cast(TextIO, PlainStream(it)) for it in behind)
