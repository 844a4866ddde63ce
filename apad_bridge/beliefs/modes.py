"""The modes of an aMussel, as far as energy and rescue are concerned: coarser than the firmware's states."""

from __future__ import annotations

from enum import IntEnum

from firmware_model.states import State

LIKELY = 0.5
"""The limit of what is more probable than not. A belief that claims to be certain has only probabilities 0 and 1."""
FULL_CHARGE = 0.999


class Mode(IntEnum):
    """Two aMussels in one mode draw alike; an aPad can plan without knowing more."""

    ASLEEP = 0
    """Asleep, except for the short wakes of its own cycle; also on the backup battery, waiting for help."""
    IDLE = 1
    """The MU is awake and its modem listens: the paper's worst case."""
    HIGH_LOAD = 2
    """The Pi works, or motors hold a depth."""
    SURFACING = 3
    FLOATING = 4
    CHARGING_PRIMARY = 5
    """Docked; the primary battery is not full yet."""
    CHARGING_SECONDARY = 6
    """Docked; the primary is full, the secondary not yet."""
    FULL = 7
    """Docked; both are full."""
    LOST = 8
    """Both batteries are empty: the aMussel can no longer surface."""


SUBMERGED = (Mode.ASLEEP, Mode.IDLE, Mode.HIGH_LOAD)
"""The modes that an aMussel chooses among by itself; an aPad causes every other mode or learns of it."""
DOCKED = (Mode.CHARGING_PRIMARY, Mode.CHARGING_SECONDARY, Mode.FULL)

_OF_STATE: dict[State, Mode] = {
    State.OFF: Mode.ASLEEP,
    State.BOOTING: Mode.IDLE,
    State.ACTIVE: Mode.IDLE,
    State.SURFACING: Mode.SURFACING,
    State.FLOATING: Mode.FLOATING,
    State.CHARGING: Mode.CHARGING_PRIMARY,
    State.RELEASED: Mode.FLOATING,
    State.SINKING: Mode.IDLE,
    State.EMPTY: Mode.ASLEEP,
    State.SLEEPING: Mode.ASLEEP,
    State.SAMPLING: Mode.ASLEEP,
    State.PROCESSING: Mode.HIGH_LOAD,
    State.AWAITING_SLOT: Mode.ASLEEP,
    State.AWAITING_BEACON: Mode.ASLEEP,
    State.TRANSMITTING: Mode.ASLEEP,
    State.HOVERING: Mode.HIGH_LOAD,
    State.REPORTING: Mode.CHARGING_PRIMARY,
    State.CALLING: Mode.ASLEEP,
    State.LOST: Mode.LOST,
}
"""Sampling, waiting for the timeslot and transmitting are the short wakes of a sleeping aMussel."""


def mode_of(state: State, primary: float, secondary: float) -> Mode:
    """The mode that a packet states; docked, the charges decide which battery is still being charged."""
    mode = _OF_STATE[state]
    if mode is Mode.CHARGING_PRIMARY and primary >= FULL_CHARGE:
        return Mode.FULL if secondary >= FULL_CHARGE else Mode.CHARGING_SECONDARY
    return mode
