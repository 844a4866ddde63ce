"""The whole firmware of a board: sleep, loads by module, two batteries, timeslots and emergencies. Agent time.

What is measured of a power path is seldom all measured by oneself: a block may name a `profile`, which gives every key
that the block does not (see `apad_bridge.scenario.profiles`).
"""

from __future__ import annotations

from enum import StrEnum
from typing import Annotated, Literal

from annotated_types import Ge, Gt, Le
from pydantic import AfterValidator

from apad_bridge.scenario.quantities import (
    ChargeSegments,
    Fraction,
    NotNegative,
    NotNegativeSeconds,
    Positive,
    PositiveSeconds,
    frozen,
)
from firmware_model.power.ageing import capacity_left
from firmware_model.power.rails import Rail


def _known_module(name: str) -> str:
    if name.upper() not in Rail.__members__ or name != name.lower():
        raise ValueError(f"must be the name of a module: {', '.join(Rail.__members__).lower()}")
    return name


ModuleName = Annotated[str, AfterValidator(_known_module)]


@frozen
class ModuleLoads:
    """Milliwatts that a module draws while it is on; 0 for one that is not fitted."""

    mu_asleep: NotNegative
    mu_active: NotNegative
    oxygen: NotNegative
    pressure: NotNegative
    temperature: NotNegative
    turbidity: NotNegative
    pi: NotNegative
    modem_listening: NotNegative
    modem_receiving: NotNegative
    modem_transmitting: NotNegative
    wifi: NotNegative
    gsm: NotNegative
    bluetooth: NotNegative
    motors: NotNegative


@frozen
class Metering:
    """How the board reads its batteries: a load pulls the voltage down, a charger lifts it, readings have noise."""

    profile: Literal["table-one"] | None = None
    period_s: PositiveSeconds
    """The monitor samples at whole multiples of this."""
    settle_s: NotNegativeSeconds
    """A level counts once every sample over so long was beyond it."""
    internal_resistance_ohm: NotNegative
    idle_mw: NotNegative
    """The load at which a voltage was called a charge: sag is counted from here."""
    lift_mv: NotNegative
    """While the charger gives."""
    noise_mv: NotNegative
    """Readings are up to so much off."""


@frozen
class Ageing:
    """What the batteries have behind them; both alike."""

    cycles: Annotated[int, Ge(0)]
    years: NotNegative

    def __post_init__(self) -> None:
        capacity_left(self.cycles, self.years)


@frozen
class BoardPower:
    profile: Literal["table-one"] | None = None
    capacity_wh: Positive
    """Of each of the two batteries."""
    loads_mw: ModuleLoads
    charge_segments: ChargeSegments
    """Of a battery charged through one coil, which is the secondary."""
    two_coils: Annotated[float, Ge(1), Le(2)]
    """How many times faster the primary charges, through its two coils."""
    path: Fraction
    """How much of the load reaches the battery that feeds the board while that is charged."""
    motor_run_s: PositiveSeconds
    receive_ms: Annotated[int, Ge(0)]
    """How long the modem draws its receiving load for a packet."""
    switch_back: Fraction
    """The board returns to a charging primary battery that holds so much."""
    kept_on: tuple[ModuleName, ...] = ()
    """Modules that nothing switches off."""
    low_level: Fraction = 0.0
    """Of the primary battery: a sleeping board wakes and reports when it is down to this; 0 for no such level."""
    metering: Metering | None = None
    """None: the board knows the charges exactly."""
    ageing: Ageing | None = None
    """None: the batteries are new."""


@frozen
class Timeslots:
    frame_s: PositiveSeconds
    slot_s: PositiveSeconds
    guard_s: NotNegativeSeconds = 0.0
    """A board speaks so long after its slot opens: clocks that are off by no more do not collide."""

    def __post_init__(self) -> None:
        if not self.guard_s < self.slot_s <= self.frame_s:
            raise ValueError("guard_s must be shorter than slot_s, and slot_s not longer than frame_s")


@frozen
class SleepCycle:
    profile: Literal["hourly", "field"] | None = None
    alarm_s: PositiveSeconds
    """The clock wakes the board at whole multiples of this."""
    sample_s: PositiveSeconds
    processing_s: NotNegativeSeconds
    """How long the Pi works on the samples."""
    listen_s: NotNegativeSeconds
    """Awake after it has come to rest on the bottom."""
    report_s: PositiveSeconds
    """Awake in a dock after it has reported, and after each acknowledgement of its log."""
    slots: Timeslots | None
    """Where its status goes out by sound; none: it goes back to sleep without."""


class LastResortAction(StrEnum):
    """`wait`: stay and listen. `call`: stay, and send its status again and again. `surface`: come up unasked."""

    WAIT = "wait"
    CALL = "call"
    SURFACE = "surface"


@frozen
class LastResort:
    """What the board does when its backup battery is down to the safe level."""

    action: LastResortAction
    safe_level: Fraction
    call_period_s: PositiveSeconds
    """Before the last resort is taken again."""
    stay_down_s: NotNegativeSeconds = 21_600.0
    """One that was told to sink does not come up by itself for so long."""


@frozen
class Timekeeping:
    """What the firmware expects of its clock, and what it does about it."""

    bound_ppm: NotNegative
    """The crystal drifts by no more."""
    beacon_wait_s: PositiveSeconds
    """Where its clock may be off by more than the guard it listens for a beacon so long, and does not speak without."""


@frozen
class WholeBoard:
    power: BoardPower
    cycle: SleepCycle | None
    """None: never asleep."""
    last_resort: LastResort
    transmit_ms: Annotated[int, Gt(0)]
    """How long the modem takes to send a status."""
    turnaround_ms: Annotated[int, Ge(0)] = 500
    """From the end of a ping until the board answers it."""
    hover_period_s: PositiveSeconds
    """Between the motor runs that hold a depth."""
    timekeeping: Timekeeping | None = None
    """None: the firmware trusts its clock."""
    clock_drift_ppm: NotNegative = 0.0
    """Each board's clock really drifts by up to so much, either way, by its own and the scenario's seed."""
