"""Ids in a message for a person."""

from __future__ import annotations

from collections.abc import Iterable


def in_ranges(ids: Iterable[int]) -> str:
    """Returns ids in short and rising, such as "1 to 4, 7, 12"; an empty text for none."""
    ranges: list[tuple[int, int]] = []
    for number in sorted(ids):
        if ranges and number == ranges[-1][1] + 1:
            ranges[-1] = (ranges[-1][0], number)
        else:
            ranges.append((number, number))
    return ", ".join(str(low) if low == high else f"{low} to {high}" for low, high in ranges)
