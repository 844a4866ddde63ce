"""The states of the MU board and the ONE transition table.

Two rules: the board refuses a pair that is missing from `TABLE`, counts it, and goes on; nothing else in the firmware
assigns a state.
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
    """The pin fell; waiting for the aPad's release packet."""
    SINKING = 7
    EMPTY = 8
    """On the bottom with the primary battery at 0: not measuring, listening on the backup battery."""
    SLEEPING = 9
    """Deep sleep on the bottom: the clock, the modem, the charger's pin and the battery monitor wake it."""
    SAMPLING = 10
    """All sensors are on."""
    PROCESSING = 11
    """The Pi works on the samples."""
    AWAITING_SLOT = 12
    TRANSMITTING = 13
    HOVERING = 14
    """Held at a depth by runs of the buoyancy motors."""
    REPORTING = 15
    """Docked and awake for a report."""
    CALLING = 16
    """On the bottom at the backup battery's safe level, sending its status; between calls it is EMPTY and listens."""
    LOST = 17
    """Both batteries are at 0: no code runs, and it can no longer surface. A charger boots it."""
    AWAITING_BEACON = 18
    """Its clock may be off by more than the guard: it does not transmit, and listens for an aPad's time."""


STATE_OF = {int(state): state for state in State}
"""The state of each number, in packets and frames."""


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
    """The board received the aPad's release packet, or the stated wait for it is over."""
    FLOAT_TIMED_OUT = 9
    BOTTOM_REACHED = 10
    BATTERY_EMPTIED = 11
    """The primary battery is empty: the backup now feeds the board (`hardware/power_path.py`)."""
    ALARM_RANG = 12
    WAKE_OVER = 13
    SAMPLES_TO_PROCESS = 14
    SAMPLES_TO_SEND = 15
    PROCESSED = 16
    SLOT_OPENED = 17
    PING_HEARD = 18
    """An aPad asks for a status. The board answers and stays in its state: it does not enter the state again."""
    HOVER_ORDERED = 19
    HOVER_DUE = 20
    """The depth is corrected by another motor run."""
    LAST_RESORT_CALL = 21
    LAST_RESORT_SURFACE = 22
    BOTH_EMPTIED = 23
    LOW_LEVEL_REACHED = 24
    """The primary battery is down to the level at which a sleeping board wakes."""
    CLOCK_DOUBTED = 25
    """The clock may be off by more than the guard of the timeslot."""
    BEACON_HEARD = 26
    SINK_ORDERED = 27
    """An aPad orders it to sink and stay on the bottom."""
    SURFACING_TIMED_OUT = 28
    """The motors ran, and it has not come up: it sticks in the mud, or its buoyancy failed."""


_S, _T = State, Trigger

# A board that was reset on its way up or down boots as if on the bottom; then the pressure sensor shows where it is.
# So every state on the bottom takes SURFACE_REACHED and a charger's edge. A transmitting board receives nothing.
_BOTTOM = (
    _S.ACTIVE,
    _S.EMPTY,
    _S.SLEEPING,
    _S.SAMPLING,
    _S.PROCESSING,
    _S.AWAITING_SLOT,
    _S.TRANSMITTING,
    _S.CALLING,
    _S.AWAITING_BEACON,
)
_LISTENING = tuple(state for state in _BOTTOM if state not in (_S.TRANSMITTING, _S.CALLING))
_ANSWERING = (*_LISTENING, _S.SURFACING, _S.SINKING, _S.HOVERING)
_UNDOCKED = (*_BOTTOM, _S.SURFACING, _S.FLOATING, _S.RELEASED, _S.SINKING, _S.HOVERING)

TABLE: dict[tuple[State, Trigger], State] = {
    (_S.OFF, _T.POWER_CAME_ON): _S.BOOTING,
    (_S.BOOTING, _T.BOOTED_ON_BOTTOM): _S.ACTIVE,
    (_S.BOOTING, _T.BOOTED_AT_SURFACE): _S.FLOATING,
    (_S.BOOTING, _T.BOOTED_ON_CHARGER): _S.CHARGING,
    # A wake and back to sleep.
    (_S.ACTIVE, _T.WAKE_OVER): _S.SLEEPING,
    (_S.SLEEPING, _T.ALARM_RANG): _S.SAMPLING,
    (_S.SAMPLING, _T.WAKE_OVER): _S.SLEEPING,
    (_S.SAMPLING, _T.SAMPLES_TO_PROCESS): _S.PROCESSING,
    (_S.SAMPLING, _T.SAMPLES_TO_SEND): _S.AWAITING_SLOT,
    (_S.PROCESSING, _T.PROCESSED): _S.AWAITING_SLOT,
    (_S.PROCESSING, _T.WAKE_OVER): _S.SLEEPING,
    (_S.AWAITING_SLOT, _T.SLOT_OPENED): _S.TRANSMITTING,
    (_S.AWAITING_SLOT, _T.CLOCK_DOUBTED): _S.AWAITING_BEACON,
    (_S.AWAITING_BEACON, _T.BEACON_HEARD): _S.AWAITING_SLOT,
    (_S.AWAITING_BEACON, _T.WAKE_OVER): _S.SLEEPING,
    (_S.TRANSMITTING, _T.WAKE_OVER): _S.SLEEPING,
    # A ping reaches it wherever its modem is in the water and not transmitting.
    **{(state, _T.PING_HEARD): state for state in _ANSWERING},
    # Up, docked, released and down.
    **{(state, _T.PERMISSION_HEARD): _S.SURFACING for state in (*_LISTENING, _S.SINKING, _S.HOVERING)},
    **{(state, _T.SURFACE_REACHED): _S.FLOATING for state in (*_BOTTOM, _S.SURFACING)},
    # Its motors did not run, for want of charge: it is still up.
    (_S.SINKING, _T.SURFACE_REACHED): _S.FLOATING,
    **{(state, _T.CHARGE_EDGE_ROSE): _S.CHARGING for state in _UNDOCKED},
    (_S.FLOATING, _T.FLOAT_TIMED_OUT): _S.SINKING,
    (_S.FLOATING, _T.CLEAR_TO_SINK): _S.SINKING,
    (_S.CHARGING, _T.ALARM_RANG): _S.REPORTING,
    (_S.CHARGING, _T.CHARGE_EDGE_FELL): _S.RELEASED,
    (_S.REPORTING, _T.WAKE_OVER): _S.CHARGING,
    (_S.REPORTING, _T.CHARGE_EDGE_FELL): _S.RELEASED,
    (_S.RELEASED, _T.CLEAR_TO_SINK): _S.SINKING,
    # The motors had run to sink while the dock held it: it sank as soon as the dock released it.
    (_S.RELEASED, _T.BOTTOM_REACHED): _S.ACTIVE,
    (_S.SINKING, _T.BOTTOM_REACHED): _S.ACTIVE,
    **{
        (state, _T.SINK_ORDERED): _S.SINKING
        for state in (_S.SURFACING, _S.FLOATING, _S.RELEASED, _S.HOVERING)
    },
    # It runs its motors back, and is ready for another permission. A body that comes free later does not rise.
    (_S.SURFACING, _T.SURFACING_TIMED_OUT): _S.SINKING,
    # Hovering at a depth.
    (_S.ACTIVE, _T.HOVER_ORDERED): _S.HOVERING,
    (_S.SLEEPING, _T.HOVER_ORDERED): _S.HOVERING,
    (_S.HOVERING, _T.HOVER_ORDERED): _S.HOVERING,
    (_S.HOVERING, _T.HOVER_DUE): _S.HOVERING,
    (_S.HOVERING, _T.CLEAR_TO_SINK): _S.SINKING,
    # Emergency. At the low level a sleeping board wakes before its alarm; then the wake runs as any other. On the way up
    # or down it continues on the other battery.
    **{(state, _T.BATTERY_EMPTIED): _S.EMPTY for state in _BOTTOM if state not in (_S.EMPTY, _S.CALLING)},
    (_S.HOVERING, _T.BATTERY_EMPTIED): _S.SINKING,
    (_S.SLEEPING, _T.LOW_LEVEL_REACHED): _S.SAMPLING,
    (_S.EMPTY, _T.LAST_RESORT_CALL): _S.CALLING,
    (_S.EMPTY, _T.LAST_RESORT_SURFACE): _S.SURFACING,
    (_S.CALLING, _T.WAKE_OVER): _S.EMPTY,
    # Also where the pin tells a dock whose charger does not feed it.
    **{(state, _T.BOTH_EMPTIED): _S.LOST for state in (*_UNDOCKED, _S.BOOTING, _S.CHARGING, _S.REPORTING)},
}


class TriggerRefused(ValueError):
    """The state has no row for the trigger."""


def next_state(state: State, trigger: Trigger) -> State:
    """The next state by `TABLE`; raises TriggerRefused before anything has changed."""
    if (found := TABLE.get((state, trigger))) is None:
        raise TriggerRefused(f"{state.name} does not take {trigger.name}")
    return found
