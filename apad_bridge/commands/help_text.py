"""The layout of a command's `--help`, and its end: examples to copy, then the exit codes."""

from __future__ import annotations

import argparse
from typing import Any

from apad_bridge.runs.exits import EXITS


class CommandParser(argparse.ArgumentParser):
    """A parser whose help keeps lines; a parser of its subcommands is one, too."""

    def __init__(self, **settings: Any) -> None:
        super().__init__(formatter_class=_KeepsLines, **settings)


def ending(*examples: str, note: str = "") -> str:
    """Returns the last part of a help: the examples, a line each, a note, and the exit codes."""
    return "\n".join(
        ["examples:", *(f"  {it}" for it in examples), *([note] if note else []), f"exit codes: {EXITS}"]
    )


class _KeepsLines(argparse.HelpFormatter):
    """Wraps each line of a text by itself, and leaves an indented line as it is: a broken example cannot be copied."""

    def _fill_text(self, text: str, width: int, indent: str) -> str:
        fill = super()._fill_text
        return "\n".join(it if it.startswith("  ") else fill(it, width, indent) for it in text.splitlines())
