"""What the simulated aPad's node does wrong, as stacks in the field do."""

from __future__ import annotations

from enum import StrEnum


class Fault(StrEnum):
    NONE = "none"

    # Of generation A.
    RELEASE_SILENT = "release_silent"
    """A release lets go, but neither the last word on position_static nor a result comes."""
    RELEASE_CRASHES = "release_crashes"
    """As published: the action server is gone with all that it held; position and battery are another node's."""
    PERCHES_NOTHING = "perches_nothing"
    """A perch succeeds and holds nothing."""

    # Of either.
    STUCK = "stuck"
    """A go-to is taken and runs, and the vehicle does not move."""

    # Of generation B.
    SILENT = "silent"
    """No word on the status topics, nor of a primitive's end."""
    REFUSES = "refuses"
    """Its services answer that they do not take the order."""
    HANGS = "hangs"
    """Its services never answer."""
    DROPS = "drops"
    """A primitive is taken and pre-empted at once."""
    LIES = "lies"
    """A go-to is done at once, wherever the vehicle is."""
    WANDERS = "wanders"
    """Dynamic positioning ends by itself after five seconds."""


OF_A = frozenset(
    {Fault.NONE, Fault.RELEASE_SILENT, Fault.RELEASE_CRASHES, Fault.PERCHES_NOTHING, Fault.STUCK}
)
OF_B = frozenset(set(Fault) - OF_A | {Fault.NONE, Fault.STUCK})
