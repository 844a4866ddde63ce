"""Faults of the simulated aPad's node, as stacks in the field have them."""

from __future__ import annotations

from enum import StrEnum


class Fault(StrEnum):
    NONE = "none"

    # Generation A.
    RELEASE_SILENT = "release_silent"
    """A release opens the dock, but the node publishes neither the last position_static message nor a result."""
    RELEASE_CRASHES = "release_crashes"
    """The published action server dies and drops all that it held; another node has position and battery."""
    PERCHES_NOTHING = "perches_nothing"
    """A perch succeeds and holds nothing."""

    SERVER_DIES = "server_dies"
    """The action server takes a go-to and dies; the vehicle moves on, and another node has position and docks."""
    COUNTS_DOCKS = "counts_docks"
    """The published defect: position_static comes for as many docks as are closed, counted from the first, not for all."""

    # Both generations.
    STUCK = "stuck"
    """A go-to is accepted and runs, but the vehicle does not move."""

    # Generation B.
    SILENT = "silent"
    """The node publishes nothing on the status topics and does not report the end of a primitive."""
    REFUSES = "refuses"
    """Its services answer that they refuse the order."""
    HANGS = "hangs"
    """Its services never answer."""
    BLOCKS = "blocks"
    """Its services wait while the servo of a docking turns; then the calls of open connections run in their order."""
    DROPS = "drops"
    """A primitive is accepted and pre-empted at once."""
    LIES = "lies"
    """The node reports a go-to as done at once, wherever the vehicle is."""
    WANDERS = "wanders"
    """Dynamic positioning ends by itself after five seconds."""


OF_A = frozenset(
    {
        Fault.NONE,
        Fault.RELEASE_SILENT,
        Fault.RELEASE_CRASHES,
        Fault.PERCHES_NOTHING,
        Fault.SERVER_DIES,
        Fault.COUNTS_DOCKS,
        Fault.STUCK,
    }
)
OF_B = frozenset(set(Fault) - OF_A | {Fault.NONE, Fault.STUCK})
