"""The error for an invalid scenario, with a line for each mistake."""

from __future__ import annotations

from collections.abc import Iterable


class ScenarioError(ValueError):
    """All mistakes in a file, one `FILE: path.to.key: message` a line (`FILE:LINE: message` for a CSV)."""

    def __init__(self, lines: Iterable[str]) -> None:
        self.lines = tuple(lines)
        super().__init__("\n".join(self.lines))
