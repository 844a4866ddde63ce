"""States that mean the same to whoever looks at a board from outside: its host, the mission, the records."""

from __future__ import annotations

from firmware_model.states import State

DOCKED = frozenset({State.CHARGING, State.REPORTING})
"""A dock holds it, and the board knows."""

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
"""Under water with its primary battery in use: what it is there for, asleep between two samples or not."""

STRANDED = frozenset({State.EMPTY, State.CALLING})
"""On the bottom with the primary battery empty: it measures nothing, but it can be told to surface."""

UP_AND_UNDOCKED = frozenset({State.FLOATING, State.RELEASED})
"""At the surface, held by nothing."""

TO_BE_FETCHED = AT_WORK | STRANDED | {State.SURFACING, State.FLOATING}
"""An aPad that goes there and permits it to surface finds it: it hears the permission, if not at once, or is up already."""

BEYOND_HELP = frozenset({State.LOST})
"""It can no longer surface, and will never say another word."""
