"""The states of the MU board and the ONE table that moves them.

Two rules: a pair that is missing from `TABLE` is refused, which the board counts and survives; nothing else in the
firmware assigns a state.
"""

from __future__ import annotations

from enum import IntEnum


class State(IntEnum):
    OFF = 0
    """No code runs: before power-on."""
    BOOTING = 1
    ACTIVE = 2
    """On the bottom, measuring."""
    SURFACING = 3
    FLOATING = 4
    """At the surface, waiting to be docked."""
    CHARGING = 5
    """Docked: the charger's pin is high."""
    RELEASED = 6
    """The pin fell; waiting for the word that it is clear to sink."""
    SINKING = 7
    EMPTY = 8
    """On the bottom with the active battery at 0: not measuring, listening on the backup battery."""


class Trigger(IntEnum):
    POWER_CAME_ON = 0
    BOOTED_ON_BOTTOM = 1
    BOOTED_AT_SURFACE = 2
    BOOTED_ON_CHARGER = 3
    PERMISSION_HEARD = 4
    """An aPad in acoustic range lets the aMussel surface."""
    SURFACE_REACHED = 5
    CHARGE_EDGE_ROSE = 6
    CHARGE_EDGE_FELL = 7
    CLEAR_TO_SINK = 8
    """The aPad's release packet was received, or the stated wait for it is over."""
    FLOAT_TIMED_OUT = 9
    BOTTOM_REACHED = 10
    BATTERY_EMPTIED = 11


_S, _T = State, Trigger

# A reset on the way up or down boots as if on the bottom; the pressure sensor then says what is so, which is why ACTIVE
# and EMPTY take SURFACE_REACHED.
TABLE: dict[tuple[State, Trigger], State] = {
    (_S.OFF, _T.POWER_CAME_ON): _S.BOOTING,
    (_S.BOOTING, _T.BOOTED_ON_BOTTOM): _S.ACTIVE,
    (_S.BOOTING, _T.BOOTED_AT_SURFACE): _S.FLOATING,
    (_S.BOOTING, _T.BOOTED_ON_CHARGER): _S.CHARGING,
    (_S.ACTIVE, _T.PERMISSION_HEARD): _S.SURFACING,
    (_S.ACTIVE, _T.BATTERY_EMPTIED): _S.EMPTY,
    (_S.ACTIVE, _T.CHARGE_EDGE_ROSE): _S.CHARGING,
    (_S.ACTIVE, _T.SURFACE_REACHED): _S.FLOATING,
    (_S.EMPTY, _T.PERMISSION_HEARD): _S.SURFACING,
    (_S.EMPTY, _T.CHARGE_EDGE_ROSE): _S.CHARGING,
    (_S.EMPTY, _T.SURFACE_REACHED): _S.FLOATING,
    (_S.SURFACING, _T.SURFACE_REACHED): _S.FLOATING,
    (_S.SURFACING, _T.CHARGE_EDGE_ROSE): _S.CHARGING,
    (_S.FLOATING, _T.CHARGE_EDGE_ROSE): _S.CHARGING,
    (_S.FLOATING, _T.FLOAT_TIMED_OUT): _S.SINKING,
    (_S.FLOATING, _T.CLEAR_TO_SINK): _S.SINKING,
    (_S.CHARGING, _T.CHARGE_EDGE_FELL): _S.RELEASED,
    (_S.RELEASED, _T.CHARGE_EDGE_ROSE): _S.CHARGING,
    (_S.RELEASED, _T.CLEAR_TO_SINK): _S.SINKING,
    (_S.SINKING, _T.BOTTOM_REACHED): _S.ACTIVE,
    (_S.SINKING, _T.CHARGE_EDGE_ROSE): _S.CHARGING,
    (_S.SINKING, _T.PERMISSION_HEARD): _S.SURFACING,
}


class Refused(ValueError):
    """The state has no row for the trigger."""


def next_state(state: State, trigger: Trigger) -> State:
    """The table's answer; raises Refused before anything has changed."""
    found = TABLE.get((state, trigger))
    if found is None:
        raise Refused(f"{state.name} does not take {trigger.name}")
    return found
