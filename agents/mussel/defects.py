"""The defects of one aMussel that last until they are healed: its buoyancy, its charger's pin, its contact in a dock.

A healthy aMussel has none of this, so its process does not load the module.
"""

from __future__ import annotations

from dataclasses import dataclass

from firmware_model.actions import RunBuoyancy

BOUNCE_MS = 20
"""Agent time between two edges of a bouncing contact: faster than a board's debounce time."""


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
