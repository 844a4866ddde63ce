"""The rails of an aMussel, one for each module that the board can switch, and the rails that each state has on."""

from __future__ import annotations

from collections.abc import Container
from dataclasses import dataclass
from enum import IntEnum

from firmware_model.entry_points import MEND
from firmware_model.power.charge import grains_per_ms
from firmware_model.sampling import sensors
from firmware_model.states import State


def _further(rails: Container[str]) -> dict[str, int]:
    """The rails of the sensors beyond the board's four, from 14 on. ImportError for one with the name of a rail."""
    if taken := [text for text, it in sensors.BROUGHT.items() if it.name.upper() in rails]:
        raise ImportError(f"the sensor {taken[0]} has the name of another module of the board: {MEND}")
    return {it.name.upper(): 14 + n for n, it in enumerate(sensors.SENSORS[4:])}


class Rail(IntEnum):
    """A module with its own switch; the MCU and the modem have one rail for each of their modes, of which one is on.

    A sensor's rail has its name: a further row of the sensors' table has its rail after these.
    """

    MU_ASLEEP = 0
    """The microcontroller asleep, with its clock."""
    MU_ACTIVE = 1
    """The microcontroller awake, in every state that does not sleep."""
    OXYGEN = 2
    """The oxygen sensor, on while the board samples or reports."""
    PRESSURE = 3
    """The pressure sensor, likewise."""
    TEMPERATURE = 4
    """The temperature sensor, likewise."""
    TURBIDITY = 5
    """The turbidity sensor, likewise."""
    PI = 6
    """The Raspberry Pi, on while it processes samples."""
    MODEM_LISTENING = 7
    """The acoustic modem, ready for a packet, also of a sleeping board."""
    MODEM_RECEIVING = 8
    """The acoustic modem for `receive_ms` of each packet that arrives, in place of listening."""
    MODEM_TRANSMITTING = 9
    """The acoustic modem while it sends; it then receives nothing."""
    WIFI = 10
    """The Wi-Fi, on while the board floats, reports in a dock, or waits for its release."""
    GSM = 11
    """The mobile radio, on while the board floats."""
    BLUETOOTH = 12
    """The Bluetooth radio, on while the board floats."""
    MOTORS = 13
    """The motors of the buoyancy, for `motor_run_s` of each run."""
    vars().update(_further(vars()))


def bits(*rails: Rail) -> int:
    """A set of rails as an integer, as the board carries them."""
    return sum(1 << rail for rail in rails)


ASLEEP = bits(Rail.MU_ASLEEP, Rail.MODEM_LISTENING)
IDLE = bits(Rail.MU_ACTIVE, Rail.MODEM_LISTENING)
SENSOR_RAILS = tuple(Rail[sensor.name.upper()] for sensor in sensors.SENSORS)
"""The rail of each sensor, in the order of the sensors' table."""
SENSORS = bits(*SENSOR_RAILS)
SENDING = bits(Rail.MU_ACTIVE, Rail.MODEM_TRANSMITTING)

RAILS: dict[State, int] = {
    State.OFF: 0,
    State.BOOTING: IDLE,
    State.ACTIVE: IDLE,
    State.SURFACING: IDLE,
    State.FLOATING: IDLE | bits(Rail.WIFI, Rail.GSM, Rail.BLUETOOTH),
    State.CHARGING: ASLEEP,
    State.RELEASED: IDLE | bits(Rail.WIFI),
    State.SINKING: IDLE,
    State.EMPTY: ASLEEP,
    State.SLEEPING: ASLEEP,
    State.SAMPLING: IDLE | SENSORS,
    State.PROCESSING: IDLE | bits(Rail.PI),
    State.AWAITING_SLOT: IDLE,
    State.TRANSMITTING: SENDING,
    State.HOVERING: IDLE,
    State.REPORTING: IDLE | SENSORS | bits(Rail.WIFI),
    State.CALLING: SENDING,
    State.LOST: 0,
    State.AWAITING_BEACON: IDLE,
}
"""Rails that are on for a time of their own in any state are not listed: motors, and a modem that receives or answers."""


def switched_in(state: State, never_asleep: bool) -> int:
    """The rails that the firmware switches on in `state`, as bits."""
    on = RAILS[state]
    return (
        on & ~bits(Rail.MU_ASLEEP) | bits(Rail.MU_ACTIVE)
        if never_asleep and on & bits(Rail.MU_ASLEEP)
        else on
    )


def powered(on: int, kept_on: int, pulsed: int) -> int:
    """The rails that have power when the firmware has switched on `on`: none of them if that is none.

    `kept_on` are rails that nothing switches off, and `pulsed` those that are on for a time of their own.
    """
    if on == 0:
        return 0
    on |= kept_on | pulsed
    if on >> Rail.MODEM_TRANSMITTING & 1:
        on &= ~bits(Rail.MODEM_RECEIVING, Rail.MODEM_LISTENING)
    elif on >> Rail.MODEM_RECEIVING & 1:
        on &= ~bits(Rail.MODEM_LISTENING)
    if on >> Rail.MU_ACTIVE & 1:
        on &= ~bits(Rail.MU_ASLEEP)
    return on


def rails_of(state: State, kept_on: int, never_asleep: bool, pulsed: int) -> int:
    """The rails that have power in `state`, as bits; `pulsed` are the rails that are on for a time of their own."""
    return powered(switched_in(state, never_asleep), kept_on, pulsed)


@dataclass(frozen=True, slots=True)
class Loads:
    """Grains a millisecond that each rail draws while it is on, in the order of `Rail`."""

    of: tuple[int, ...]

    @classmethod
    def from_minutes(cls, per_minute: dict[Rail, float]) -> Loads:
        """Makes loads of scaled voltage a simulated minute. ValueError if a rail is missing."""
        if missing := [rail.name for rail in Rail if rail not in per_minute]:
            raise ValueError(f"no load is given for {', '.join(missing)}")
        return cls(tuple(grains_per_ms(per_minute[rail]) for rail in Rail))

    def total(self, on: int) -> int:
        """The sum of the loads of the rails in `on`."""
        return sum(load for rail, load in enumerate(self.of) if on >> rail & 1)
