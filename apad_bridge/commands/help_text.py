"""The layout of a command's `--help`, its end (examples to copy, then the exit codes), and the form of a mission time."""

from __future__ import annotations

import argparse
import re
import sys
from collections.abc import Sequence
from difflib import get_close_matches
from itertools import takewhile
from typing import Any, NoReturn

from apad_bridge.runs.exits import EXITS

_TIME = re.compile(r"(?:(?:(\d+):)?(\d+):)?(\d+(?:\.\d+)?)", re.ASCII)
MISSION_TIME = "mission time as 14:20 (minutes and seconds), 1:00:00, or seconds"
STRATEGY = "NAME|FILE.py:CLASS"
"""The form of a strategy's name, as every `--strategy` takes it."""


class CommandParser(argparse.ArgumentParser):
    """A parser whose help keeps lines, and that names the nearest option; a parser of its subcommands is one, too."""

    def __init__(self, **settings: Any) -> None:
        super().__init__(formatter_class=_KeepsLines, **settings)
        self._given: Sequence[str] = ()

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> tuple[Any, list[str]]:
        """Parses all arguments: the innermost command that meets an unknown one refuses it with its own usage."""
        self._given = sys.argv[1:] if args is None else args
        known, rest = super().parse_known_args(args, namespace)
        if rest:
            self.error(f"unrecognized arguments: {' '.join(rest)}")
        return known, rest

    def error(self, message: str) -> NoReturn:
        """Names an option that this command does not have before any other mistake, which may follow from it."""
        wrong = (
            None
            if self._subparsers
            else next(filter(self._is_unknown, takewhile("--".__ne__, self._given)), None)
        )
        if wrong is not None:
            option = wrong.partition("=")[0]
            near = get_close_matches(option, self._option_string_actions, n=1)
            meant = f"did you mean {near[0]}?" if near else f"`{self.prog} --help` lists all"
            message = f"there is no option {option}: {meant}"
        super().error(message)

    def _is_unknown(self, argument: str) -> bool:
        option = argument.partition("=")[0]
        return option.startswith("--") and not any(
            it.startswith(option) for it in self._option_string_actions
        )


def ending(*examples: str, note: str = "") -> str:
    """Returns the last part of a help: the examples, a line each, a note, and the exit codes."""
    return "\n".join(
        ["examples:", *(f"  {it}" for it in examples), *([note] if note else []), f"exit codes: {EXITS}"]
    )


def mission_seconds(text: str) -> float:
    """The type of an argument that is a mission time, as every command takes it."""
    if (found := _TIME.fullmatch(text)) is None:
        raise argparse.ArgumentTypeError(f"{text}: a mission time is 14:20, 1:00:00 or seconds")
    hours, minutes, seconds = (float(it or 0) for it in found.groups())
    return 3600 * hours + 60 * minutes + seconds


class _KeepsLines(argparse.HelpFormatter):
    """Wraps each line of a text by itself, and leaves an indented line as it is: a broken example cannot be copied."""

    def _fill_text(self, text: str, width: int, indent: str) -> str:
        fill = super()._fill_text
        return "\n".join(it if it.startswith("  ") else fill(it, width, indent) for it in text.splitlines())
