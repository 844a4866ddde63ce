"""The parts of a board that may fail. A module of its own: who only names a part loads nothing else."""

from __future__ import annotations

from enum import IntEnum, unique


@unique
class BoardPart(IntEnum):
    """A part of the board that may fail, and the meaning of the value of its failure."""

    BUS = 0
    """1: the sensors do not answer on the bus."""
    CONVERTER = 1
    """The readings of the batteries are off by up to so many grains."""
    UARTS = 2
    """Only so many bytes of each packet arrive; the rest overruns."""
    WRITES = 3
    """Only so many bytes of each write reach the flash."""
    CELLS = 4
    """A mask of the bits that stay erased in each byte written to the flash."""
    SUPPLY = 5
    """A brown-out resets the board once, after so many bytes of its next write to the flash."""
    HOLD = 6
    """1: the converter holds its readings of the batteries, which stay as they are."""
    FLASH = 7
    """1: the flash does not answer: it reads as erased, and nothing is written or erased."""
    DEPTH = 8
    """1: the pressure sensor stands: it notices neither the surface nor the bottom."""


WHOLE_ONLY = (BoardPart.BUS, BoardPart.WRITES, BoardPart.CELLS, BoardPart.SUPPLY, BoardPart.FLASH)
"""The parts that the worst case does not have: it has no sensors and no flash."""
