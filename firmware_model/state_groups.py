"""Groups of states that mean the same to the code outside a board: its host, the mission, the records."""

from __future__ import annotations

from firmware_model.states import State

DOCKED = frozenset({State.CHARGING, State.REPORTING})
"""A dock holds the aMussel, and the board has detected the contact."""

AT_WORK = frozenset(
    {
        State.ACTIVE,
        State.SLEEPING,
        State.SAMPLING,
        State.PROCESSING,
        State.AWAITING_SLOT,
        State.AWAITING_BEACON,
        State.TRANSMITTING,
        State.HOVERING,
    }
)
"""Under water with its primary battery in use, doing its work; also asleep between two samples."""

STRANDED = frozenset({State.EMPTY, State.CALLING})
"""On the bottom with the primary battery empty: it measures nothing, but it takes a permission to surface."""

UP_AND_UNDOCKED = frozenset({State.FLOATING, State.RELEASED})
"""At the surface, not in a dock."""

TO_BE_FETCHED = AT_WORK | STRANDED | {State.SURFACING, State.FLOATING}
"""An aPad that goes there can fetch it: it receives the permission to surface, if not at once, or is up already."""

BEYOND_HELP = frozenset({State.LOST})
"""It can no longer surface, and will never transmit again."""
