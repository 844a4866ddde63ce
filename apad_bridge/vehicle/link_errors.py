"""Errors of a vehicle link, none a mistake of the caller: a vehicle is not ready, a peer died or fell silent."""

from __future__ import annotations


class PeerFailed(RuntimeError):
    """A peer that the run needs failed, or one of each of several aPads.

    A line for each names the peer, the consequence and the place to look.
    """

    def __init__(self, *lines: str) -> None:
        super().__init__("; ".join(lines))
        self.lines = lines


class VehicleNotReady(Exception):
    """A part of the aPad is missing. One line names the part and the remedy."""
