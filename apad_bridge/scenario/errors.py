"""What is wrong with a scenario, as lines for the person who wrote it."""

from __future__ import annotations

from collections.abc import Iterable


class ScenarioError(ValueError):
    """Everything that is wrong with a file, one `FILE: path.to.key: message` a line (`FILE:LINE: message` for a CSV)."""

    def __init__(self, lines: Iterable[str]) -> None:
        self.lines = tuple(lines)
        super().__init__("\n".join(self.lines))
