"""The console for people, and the forms of a result. Control characters of others' texts are shown and not obeyed."""

from __future__ import annotations

import json
from collections.abc import Callable, Collection, Iterable, Sequence
from typing import IO, Any

import rich.console
from rich.console import ConsoleOptions, RenderableType
from rich.segment import Segment
from rich.table import Table
from rich.text import Text

from apad_bridge.runs.exits import Exit
from apad_bridge.runs.terminal import PlainStream
from firmware_model.control_characters import shown


class Console(rich.console.Console):
    """rich's console, whose own styles and cursor movements alone reach a terminal."""

    @property
    def file(self) -> IO[str]:
        file = super().file
        return file.behind if isinstance(file, PlainStream) else file

    @file.setter
    def file(self, new: IO[str]) -> None:
        self._file = new

    def on_broken_pipe(self) -> None:
        """In place of rich's, which ends the process at once: a command whose result nobody reads fails as any other."""
        raise  # rich calls this where it handles the error

    def render_str(self, text: str, **options: Any) -> Text:
        """Shows the control characters of a plain text before rich measures it."""
        return super().render_str(shown(text), **options)

    def render(self, renderable: RenderableType, options: ConsoleOptions | None = None) -> Iterable[Segment]:
        for segment in super().render(renderable, options):
            yield segment if segment.control else segment._replace(text=shown(segment.text))


def print_result(as_json: bool, data: Any, show: Callable[[], object], indent: int | None = None) -> Exit:
    """Prints a command's result on stdout, as JSON or as `show` does for a person. Returns `Exit.DONE`."""
    if as_json:
        print(json.dumps(data, indent=indent))
    else:
        show()
    return Exit.DONE


def table_of(title: str, headings: Sequence[str], left: Collection[str] = ("",), **style: Any) -> Table:
    """An empty table; its columns stand on the right but for those of `left`. `style` is of rich's Table."""
    table = Table(title=title, **style)
    for heading in headings:
        table.add_column(heading, justify="left" if heading in left else "right", overflow="fold")
    return table
