"""A modem's states. It is half duplex, so it does one thing at a time. A transition outside `TABLE` raises."""

from __future__ import annotations

from enum import IntEnum


class ModemState(IntEnum):
    OFF = 0
    LISTENING = 1
    RECEIVING = 2
    TRANSMITTING = 3
    SLEEPING = 4
    """After `$Z`: the receiver is off, and no sound wakes it."""


class ModemTrigger(IntEnum):
    POWER_CAME = 0
    POWER_WENT = 1
    SOUND_BEGAN = 2
    SOUND_ENDED = 3
    SENDING_BEGAN = 4
    SENDING_ENDED = 5
    SLEEP_ORDERED = 6
    WAKE_ORDERED = 7
    RESET_ORDERED = 8


TABLE: dict[tuple[ModemState, ModemTrigger], ModemState] = {
    (ModemState.OFF, ModemTrigger.POWER_CAME): ModemState.LISTENING,
    (ModemState.LISTENING, ModemTrigger.SOUND_BEGAN): ModemState.RECEIVING,
    (ModemState.LISTENING, ModemTrigger.SENDING_BEGAN): ModemState.TRANSMITTING,
    (ModemState.LISTENING, ModemTrigger.SLEEP_ORDERED): ModemState.SLEEPING,
    (ModemState.LISTENING, ModemTrigger.RESET_ORDERED): ModemState.LISTENING,
    (ModemState.LISTENING, ModemTrigger.POWER_WENT): ModemState.OFF,
    (ModemState.RECEIVING, ModemTrigger.SOUND_ENDED): ModemState.LISTENING,
    (ModemState.RECEIVING, ModemTrigger.SENDING_BEGAN): ModemState.TRANSMITTING,
    (ModemState.RECEIVING, ModemTrigger.SLEEP_ORDERED): ModemState.SLEEPING,
    (ModemState.RECEIVING, ModemTrigger.RESET_ORDERED): ModemState.LISTENING,
    (ModemState.RECEIVING, ModemTrigger.POWER_WENT): ModemState.OFF,
    (ModemState.TRANSMITTING, ModemTrigger.SENDING_ENDED): ModemState.LISTENING,
    (ModemState.TRANSMITTING, ModemTrigger.POWER_WENT): ModemState.OFF,
    (ModemState.SLEEPING, ModemTrigger.WAKE_ORDERED): ModemState.LISTENING,
    (ModemState.SLEEPING, ModemTrigger.POWER_WENT): ModemState.OFF,
}

RECEPTIVE = frozenset({ModemState.LISTENING, ModemState.RECEIVING})

SUPPLY_UA: dict[ModemState, int] = {
    ModemState.OFF: 0,
    ModemState.LISTENING: 2_500,
    ModemState.RECEIVING: 5_000,
    ModemState.TRANSMITTING: 300_000,
    ModemState.SLEEPING: 0,
}
"""Microamperes from 5 V, by the data sheet: up to 300 mA when transmitting. It publishes no figure for sleep."""


def next_state(state: ModemState, trigger: ModemTrigger) -> ModemState:
    """ValueError for a transition that is not in the table."""
    try:
        return TABLE[state, trigger]
    except KeyError:
        raise ValueError(f"{trigger.name} in {state.name}") from None
