"""The layout of a command's `--help`, its end (examples to copy, then the exit codes), and the form of a mission time."""

from __future__ import annotations

import argparse
import re
from typing import Any

from apad_bridge.runs.exits import EXITS

_TIME = re.compile(r"(?:(?:(\d+):)?(\d+):)?(\d+(?:\.\d+)?)", re.ASCII)
MISSION_TIME = "mission time as 14:20 (minutes and seconds), 1:00:00, or seconds"


class CommandParser(argparse.ArgumentParser):
    """A parser whose help keeps lines; a parser of its subcommands is one, too."""

    def __init__(self, **settings: Any) -> None:
        super().__init__(formatter_class=_KeepsLines, **settings)


def ending(*examples: str, note: str = "") -> str:
    """Returns the last part of a help: the examples, a line each, a note, and the exit codes."""
    return "\n".join(
        ["examples:", *(f"  {it}" for it in examples), *([note] if note else []), f"exit codes: {EXITS}"]
    )


def mission_seconds(text: str) -> float:
    """The type of an argument that is a mission time, as every command takes it."""
    found = _TIME.fullmatch(text)
    if found is None:
        raise argparse.ArgumentTypeError(f"{text}: a mission time is 14:20, 1:00:00 or seconds")
    hours, minutes, seconds = (float(it or 0) for it in found.groups())
    return 3600 * hours + 60 * minutes + seconds


class _KeepsLines(argparse.HelpFormatter):
    """Wraps each line of a text by itself, and leaves an indented line as it is: a broken example cannot be copied."""

    def _fill_text(self, text: str, width: int, indent: str) -> str:
        fill = super()._fill_text
        return "\n".join(it if it.startswith("  ") else fill(it, width, indent) for it in text.splitlines())
