"""The defects of one aMussel that last until they are healed: its buoyancy, its contact in a dock, parts of its board.

A healthy aMussel has none of this, so its process does not load the module.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import IntEnum, unique

from firmware_model.actions import RunBuoyancy

BOUNCE_MS = 20
"""Agent time between two edges of a bouncing contact: faster than a board's debounce time."""


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


@dataclass(slots=True)
class Defects:
    """The agent reads and changes them. They are the process's: one that starts again is healthy until it is told."""

    jammed: bool = False
    """The motors do not move the buoyancy."""
    held_run: RunBuoyancy | None = None
    """The last motor run that the jam held up."""
    inverted: bool = False
    """The level on the pin's wire is the opposite of the charger's."""
    unseen: bool = False
    """The pin's edges cause no interrupt."""
    bounces: int = 0
    """The contact in the dock will open or close so often yet, each time after `BOUNCE_MS`; it is open if this is odd."""
    parts: dict[BoardPart, int] = field(default_factory=dict)
    """The parts of the board that fail, with their values."""

    @property
    def depth_stands(self) -> bool:
        return BoardPart.DEPTH in self.parts
