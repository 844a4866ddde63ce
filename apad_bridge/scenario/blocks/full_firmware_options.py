"""The block `board.whole`: sleep, loads by module, two batteries, timeslots and emergencies, in agent time.

Few users measure a whole power path themselves, so a block may name a `profile`, which gives every key
that the block leaves out (see `apad_bridge.scenario.profiles`).
"""

from __future__ import annotations

from typing import Annotated, Literal, TypeVar

from annotated_types import Ge, Gt, Le
from pydantic import AfterValidator

from agents.water.bounds import NotNegative
from apad_bridge.scenario.quantities import (
    ChargeSegments,
    DischargeCurve,
    Fraction,
    Milliseconds,
    NotNegativeSeconds,
    PositiveSeconds,
    frozen,
)
from firmware_model import config
from firmware_model.power.ageing import capacity_left
from firmware_model.power.charge import ChargeModel, grains, grains_per_ms
from firmware_model.power.rails import Rail

_COIL_UNIT = 10_000


def _known_module(name: str) -> str:
    if name.upper() not in Rail.__members__ or name != name.lower():
        raise ValueError(f"must be the name of a module: {', '.join(Rail.__members__).lower()}")
    return name


ModuleName = Annotated[str, AfterValidator(_known_module)]
ModuleSchema = TypeVar("ModuleSchema")


def _with_modules(schema: type[ModuleSchema]) -> type[ModuleSchema]:
    """Gives a schema a required key for each module, in the order of `Rail`."""
    for rail in Rail:
        schema.__annotations__[rail.name.lower()] = NotNegative
    return schema


@frozen
@_with_modules
class ModuleLoads:
    """Milliwatts that each module of `Rail` draws while it is on; 0 for a module that is not fitted."""


@frozen
class MeteringOptions:
    """The board's readings of its batteries: a load pulls the voltage down, a charger lifts it, noise is added."""

    profile: Literal["table-one"] | None = None
    """Gives the keys that are left out."""
    period_s: PositiveSeconds
    """The monitor samples at whole multiples of this."""
    settle_s: NotNegativeSeconds
    """The board accepts a level once every sample over this time was beyond it."""
    internal_resistance_ohm: NotNegative
    """A load lowers the voltage by this, at 3.7 V."""
    idle_mw: NotNegative
    """The load at which a voltage was taken for a charge: the sag counts from here."""
    lift_mv: NotNegative
    """The rise while the charger gives current; 600 mV are the whole range. So a docked board reports too much: with
    `table-one` 0.99 at a true 0.95."""
    noise_mv: NotNegative
    """The largest error of a reading, either way."""
    discharge_curve: DischargeCurve = ((0.0, 0.0), (1.0, 1.0))
    """(charge, scaled voltage at `idle_mw`); the default is the paper's straight line. With another a charge is the share
    of the energy that is left, in `charge_segments` too."""


@frozen
class Ageing:
    """The past of the batteries, alike for both."""

    cycles: Annotated[int, Ge(0), Le(1_000_000)]
    """Full charge cycles; a hundred take 4 % of the capacity."""
    years: NotNegative
    """Age; each year takes 3 %."""

    def __post_init__(self) -> None:
        capacity_left(self.cycles, self.years)


@frozen
class BoardPower:
    profile: Literal["table-one"] | None = None
    """Gives the keys that are left out: all that we fitted to the paper's Table I."""
    capacity_wh: Annotated[float, Ge(0.001), Le(1e6)]
    """The capacity of each of the two batteries, which converts milliwatts into charge. Charging has rates of its own."""
    loads_mw: ModuleLoads
    """The load of each module while it is on; 0 for a module that is not fitted."""
    charge_segments: ChargeSegments
    """The charging of a battery through one coil, as the secondary has it."""
    two_coils: Annotated[float, Ge(1), Le(2)]
    """Factor by which the primary charges faster, through its two coils."""
    path: Fraction
    """The fraction of the load that reaches the feeding battery while that battery is charged."""
    motor_run_s: PositiveSeconds
    """The length of a run of the motors, for surfacing, for sinking and for each correction of a depth."""
    receive_ms: Milliseconds
    """The time for which the modem draws its receiving load for a packet."""
    switch_back: Fraction
    """The board returns to the charging primary battery when it holds this charge."""
    kept_on: tuple[ModuleName, ...] = ()
    """Modules that nothing switches off."""
    low_level: Fraction = 0.0
    """A sleeping board wakes once and reports when its primary battery is down to this; 0 for no such level."""
    metering: MeteringOptions | None = None
    """The board's readings of its batteries; or `table-one`. None: the board knows the charges exactly."""
    ageing: Ageing | None = None
    """The past of the batteries, alike for both. None: they are new."""
    secondary: Literal["backup", "in_use"] = "backup"
    """`backup`, or `in_use`: the board works on its secondary, too, when its primary is empty; with a last resort that
    moves or calls, down to `safe_level`."""

    def charge_as_new(self) -> ChargeModel:
        """The model of its batteries' charge, when they are new."""
        one_coil = tuple((grains(end), grains_per_ms(rate)) for end, rate in self.charge_segments)
        factor = round(self.two_coils * _COIL_UNIT)
        return ChargeModel(0, one_coil, tuple((end, rate * factor // _COIL_UNIT) for end, rate in one_coil))


@frozen
class TimeslotOptions:
    frame_s: PositiveSeconds
    """Frames follow each other without a gap; each has a timeslot for every aMussel, in the order of the ids."""
    slot_s: PositiveSeconds
    """One timeslot: at least a status with the guard on both sides."""
    guard_s: NotNegativeSeconds = 0.0
    """A board transmits this long after its timeslot opens: clocks that are off by no more cause no collisions."""

    def __post_init__(self) -> None:
        if not self.guard_s < self.slot_s <= self.frame_s:
            raise ValueError("guard_s must be shorter than slot_s, and slot_s not longer than frame_s")


@frozen
class SleepCycle:
    profile: Literal["hourly", "field"] | None = None
    """Gives the keys that are left out. `hourly`: Table I's short wake of 10 s an hour. `field`: the wake of several
    minutes of Fig. 4: sample, process, await the timeslot, transmit."""
    alarm_s: PositiveSeconds
    """The clock wakes the board at whole multiples of this, longer than a wake; in a dock the board then reports."""
    sample_s: PositiveSeconds
    """The time for which the sensors are on: the whole of a short wake."""
    processing_s: NotNegativeSeconds
    """The time for which the Pi works on the samples."""
    listen_s: NotNegativeSeconds
    """The time that the board stays awake after it has come to rest on the bottom."""
    report_s: PositiveSeconds
    """The time that it stays awake in a dock after a report and after each acknowledgement of its log; longer than theta
    seconds, because the aPad answers at its own next second."""
    slots: TimeslotOptions | None
    """The timeslots of the acoustic status; `null`: the board goes back to sleep without sending one."""


@frozen
class LastResortOptions:
    """The board's action when its backup battery is down to the safe level."""

    action: config.LastResort
    """`wait`: stay and listen. `call`: stay and send its status again and again. `surface`: come up without a
    permission."""
    safe_level: Fraction
    """The charge of the backup battery at which it acts."""
    call_period_s: PositiveSeconds
    """The time before the board takes the last resort again."""
    stay_down_s: NotNegativeSeconds = 21_600.0
    """A board that was ordered to sink does not surface by itself for this long."""


@frozen
class TimekeepingOptions:
    """The drift that the firmware assumes of its clock, and its wait for a beacon."""

    bound_ppm: NotNegative
    """The largest drift of the clock, by its data sheet."""
    beacon_wait_s: PositiveSeconds
    """A board whose clock may be off by more than the guard listens this long for a beacon, and does not transmit
    without one."""


@frozen
class FullFirmwareOptions:
    power: BoardPower
    """Loads and batteries; or `table-one`."""
    cycle: SleepCycle | None
    """Its sleep and its wakes; or `hourly`, `field`, or `never`, which is None: always awake."""
    last_resort: LastResortOptions
    transmit_ms: Annotated[Milliseconds, Gt(0)]
    """The time that the modem takes to send a status."""
    turnaround_ms: Milliseconds = 500
    """The time from the end of a PING until the board, awake by then, answers it."""
    hover_period_s: PositiveSeconds
    """The time between the motor runs that hold a depth; longer than such a run."""
    timekeeping: TimekeepingOptions | None = None
    """The clock error that the firmware expects. None: the firmware trusts its clock."""
    clock_drift_ppm: NotNegative = 0.0
    """The largest real drift of a board's clock, either way; the board's and the scenario's seed decide it."""
