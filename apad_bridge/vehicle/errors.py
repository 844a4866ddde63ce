"""What a vehicle link raises when it cannot be flown with.

Failures that are nobody's mistake in what was asked: a peer that died or fell silent.
"""

from __future__ import annotations


class PeerFailed(RuntimeError):
    """Something that the run needs failed: one line that says what, what follows from it, and where to look."""


class VehicleNotReady(Exception):
    """One line: which part of the aPad is missing, and what to do."""
