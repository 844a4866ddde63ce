"""The errors for a user's mistakes and for an invalid scenario, and ids in a message for a person."""

from __future__ import annotations

from collections.abc import Iterable


class UserError(Exception):
    """A mistake of the user's: the text is one clear line, with the mend. A command that raises it ends with that line."""


class ScenarioError(UserError, ValueError):
    """All mistakes in a file, one `FILE: path.to.key: message` a line (`FILE:LINE: message` for a CSV).

    A character that does not print is escaped, because a name or a key of YAML may hold a line break or a terminal's codes.
    """

    def __init__(self, lines: Iterable[str]) -> None:
        self.lines = tuple("".join(map(_escaped, line)) for line in lines)
        super().__init__("\n".join(self.lines))


def _escaped(character: str) -> str:
    return character if character.isprintable() else character.encode("unicode_escape").decode()


def in_ranges(ids: Iterable[int]) -> str:
    """Returns ids in short and rising, such as "1 to 4, 7, 12"; an empty text for none."""
    ranges: list[tuple[int, int]] = []
    for number in sorted(ids):
        if ranges and number == ranges[-1][1] + 1:
            ranges[-1] = (ranges[-1][0], number)
        else:
            ranges.append((number, number))
    return ", ".join(str(low) if low == high else f"{low} to {high}" for low, high in ranges)
