"""What a vehicle link raises when it cannot be flown with."""

from __future__ import annotations


class VehicleNotReady(Exception):
    """One line: which part of the aPad is missing, and what to do."""
