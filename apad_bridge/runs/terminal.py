"""Text for people on its way to a terminal: control characters of others are shown, and not obeyed.

Texts come from strategies, scripts, boards, ROS nodes and strangers' records. A terminal would obey an escape sequence in
them, which moves the cursor, writes over other lines or sets its title. The command's stdout and stderr go through here.
"""

from __future__ import annotations

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


def show_control_characters() -> None:
    """From now on this process's stdout and stderr show them."""
    sys.stdout, sys.stderr = (cast(TextIO, PlainStream(it)) for it in (sys.stdout, sys.stderr))
