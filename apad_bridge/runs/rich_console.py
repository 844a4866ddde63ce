"""The console for people. Each text in it comes from others, so its control characters are shown and not obeyed."""

from __future__ import annotations

from collections.abc import Iterable
from typing import IO, Any

import rich.console
from rich.console import ConsoleOptions, RenderableType
from rich.segment import Segment
from rich.text import Text

from apad_bridge.runs.terminal import PlainStream
from firmware_model.bench.control_characters import shown


class Console(rich.console.Console):
    """rich's console, whose own styles and cursor movements alone reach a terminal."""

    @property
    def file(self) -> IO[str]:
        file = super().file
        return file.behind if isinstance(file, PlainStream) else file

    @file.setter
    def file(self, new: IO[str]) -> None:
        self._file = new

    def render_str(self, text: str, **options: Any) -> Text:
        """Shows the control characters of a plain text before rich measures it."""
        return super().render_str(shown(text), **options)

    def render(self, renderable: RenderableType, options: ConsoleOptions | None = None) -> Iterable[Segment]:
        for segment in super().render(renderable, options):
            yield segment if segment.control else segment._replace(text=shown(segment.text))
