"""What a board with sleep, rails and two batteries is configured with. Milliseconds of agent time; charge in grains."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

from firmware_model.power.charge import ChargeModel
from firmware_model.power.rails import Loads

PATH_UNIT = 10_000


class LastResort(IntEnum):
    """What an aMussel on its backup battery does at the safe level, before it can no longer surface."""

    WAIT = 0
    """Stay on the bottom and listen."""
    CALL = 1
    """Stay and send its status again and again."""
    SURFACE = 2
    """Come up without a permission: the one case in which it does."""


@dataclass(frozen=True, slots=True)
class Metering:
    """How a board reads its batteries: voltage = charge - sag + lift + noise, all in grains of the scaled voltage.

    Table I's and the equations' curves are voltages of an idle board, so sag is counted from the load that those had.
    """

    period_ms: int
    """The monitor samples at whole multiples of it."""
    settle_ms: int
    """A level counts once every sample over so long was beyond it. Longer than a motor run, or that makes an emergency."""
    sag_ms: int = 0
    """Internal resistance: grains of voltage for each grain a millisecond of load above `sag_from`."""
    sag_from: int = 0
    lift: int = 0
    """While its charger gives."""
    noise: int = 0
    """Readings are up to so much off, either way, all alike."""
    seed: int = 0
    """Of the noise, which is a keyed hash of (seed, agent id, number of the sample)."""

    def __post_init__(self) -> None:
        if self.period_ms <= 0 or min(self.settle_ms, self.sag_ms, self.sag_from, self.lift, self.noise) < 0:
            raise ValueError("period_ms must be positive, and nothing else of a Metering negative")


@dataclass(frozen=True, slots=True)
class Power:
    """Loads by module, two batteries, and the path between charger, batteries and board.

    `path` is how much of the load reaches the battery that feeds the board while that is charged, in 1/10000: Table I's
    charging times do not superpose with its discharging times, so this is a parameter of its own.
    """

    loads: Loads
    path: int
    motor_run_ms: int
    receive_ms: int
    """How long the modem draws its receiving load for a packet; spent from the packet's end on, which is when it acts."""
    switch_back: int
    """The board returns to the primary battery once that holds so much."""
    safe_level: int
    """Of the backup battery: the last resort is taken here."""
    last_resort: LastResort
    kept_on: int = 0
    """Rails that nothing switches off, as bits."""
    metering: Metering | None = None
    """None: the board knows the charges exactly, and every level counts at once."""
    low_level: int = 0
    """Of the primary battery: a sleeping board wakes when it falls to it; 0 for no such level."""

    def __post_init__(self) -> None:
        if not 0 <= self.path <= PATH_UNIT:
            raise ValueError(f"path must lie in 0 to {PATH_UNIT}, not {self.path}")


@dataclass(frozen=True, slots=True)
class Slots:
    """Acoustic timeslots as arithmetic on the time, the same for all boards; each has one of them in every frame."""

    frame_ms: int
    slot_ms: int
    guard_ms: int = 0
    """A board speaks so long after its slot opens; clocks that are off by no more do not collide."""

    def __post_init__(self) -> None:
        if not 0 <= self.guard_ms < self.slot_ms <= self.frame_ms:
            raise ValueError("a guard must be shorter than its slot, and a slot not longer than the frame")

    @property
    def count(self) -> int:
        """How many whole slots a frame has."""
        return self.frame_ms // self.slot_ms


@dataclass(frozen=True, slots=True)
class Cycle:
    """When the board sleeps and what a wake does. The alarm rings at whole multiples of its period."""

    alarm_ms: int
    sample_ms: int
    """How long the sensors are on: the whole of a short wake."""
    processing_ms: int
    """How long the Pi works on the samples; 0 when a wake does without."""
    slots: Slots | None
    """Where the board awaits its timeslot and transmits; None when it goes back to sleep instead."""
    listen_ms: int
    """How long it stays awake after it has come to rest on the bottom."""
    report_ms: int
    """How long it stays awake in a dock after it has reported, and after each word that its log came across."""

    def __post_init__(self) -> None:
        if self.alarm_ms <= 0:
            raise ValueError("alarm_ms must be positive")


@dataclass(frozen=True, slots=True)
class Timekeeping:
    """What the firmware may expect of its clock, and what it does about it."""

    bound_ppb: int
    """The crystal drifts by no more, in parts of 10^9, says its data sheet."""
    beacon_wait_ms: int
    """Where it may be off by more than the guard, it does not speak, and listens for a beacon for so long."""

    def __post_init__(self) -> None:
        if self.bound_ppb < 0 or self.beacon_wait_ms <= 0:
            raise ValueError("bound_ppb must not be negative, and beacon_wait_ms positive")


@dataclass(frozen=True, slots=True)
class FullFirmware:
    """The whole firmware; a board without one is the paper's worst case: one battery, one load, never asleep."""

    power: Power
    cycle: Cycle | None
    """None: never asleep."""
    transmit_ms: int
    call_ms: int
    """Between the calls of a last resort."""
    hover_ms: int
    """Between the motor runs that hold a depth."""
    stay_down_ms: int = 21_600_000
    """One that was told to sink takes no last resort that brings it up for so long: 6 h."""
    timekeeping: Timekeeping | None = None
    """None: it trusts its clock."""
    turnaround_ms: int = 500
    """From a ping's end until it answers: it wakes, reads its batteries, and tells its modem."""
    answer_ms: int = 393
    """How long the modem sends the answer: a v3 nanomodem's 7 bytes."""

    def __post_init__(self) -> None:
        if self.turnaround_ms < 0 or self.answer_ms <= 0:
            raise ValueError("turnaround_ms must not be negative, and answer_ms positive")


@dataclass(frozen=True, slots=True)
class BoardConfig:
    """Numbers of one board; milliseconds of agent time."""

    agent_id: int
    charge: ChargeModel
    pin_debounce_ms: int
    boot_ms: int
    float_timeout_ms: int
    release_wait_ms: int
    whole: FullFirmware | None = None
    """Sleep, rails and two batteries; None is the paper's worst case."""
    slot: int = 0
    """Which acoustic timeslot of every frame is this board's."""
    pin_chatter_ms: int = 2000
    """A charger's pin that bounces for so long is decided by the level that it had for the greater part of it."""
    pin_check_ms: int = 60_000
    """The pin's level is sampled at whole multiples of it, and at every wake: that finds an edge that was missed."""
    drift_ppb: int = 0
    """What the board's clock gains on agent time, in parts of 10^9."""

    def __post_init__(self) -> None:
        cycle = None if self.whole is None else self.whole.cycle
        if cycle is not None and cycle.slots is not None and not 0 <= self.slot < cycle.slots.count:
            raise ValueError(f"slot {self.slot} does not lie in a frame of {cycle.slots.count}")
        if not self.pin_debounce_ms < self.pin_chatter_ms or self.pin_check_ms <= 0:
            raise ValueError("pin_chatter_ms must be longer than pin_debounce_ms, and pin_check_ms positive")
