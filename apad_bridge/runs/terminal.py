"""Text for people on its way to a terminal: control characters of others are shown, and not obeyed.

Texts come from strategies, scripts, boards, ROS nodes and strangers' records. A terminal would obey an escape sequence in
them, which moves the cursor, writes over other lines or sets its title. The command's stdout and stderr go through here.

A reader of stderr that leaves, as `head` in `musselbed run ... 2>&1 | head`, is as a terminal that hangs up: a flight ends
in order, with complete records. One of stdout makes the result worthless, so the command fails.
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
        try:
            self.behind.write(shown(text))
        except BrokenPipeError:
            if self.behind is not sys.__stderr__:
                raise
            hang_up()
        return len(text)

    def writelines(self, lines: list[str]) -> None:
        self.behind.writelines(map(shown, lines))

    def __getattr__(self, name: str) -> Any:
        return getattr(self.behind, name)


def hang_up() -> None:
    """Nobody reads stderr any more: drops all further text there, and asks this process to end as SIGHUP does."""
    discard(sys.stderr)
    signal.raise_signal(signal.SIGHUP)


def discard(stream: TextIO) -> None:
    """Lets the interpreter's own flush at its exit succeed: what could not be written once is not tried again."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())


def show_control_characters() -> None:
    """From now on this process's stdout and stderr show them."""
    sys.stdout, sys.stderr = (cast(TextIO, PlainStream(it)) for it in (sys.stdout, sys.stderr))
