"""The configuration of a board. Milliseconds of agent time; charge in grains."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from enum import StrEnum

from firmware_model.power.charge import ChargeModel
from firmware_model.power.rails import Loads
from firmware_model.power.voltage_curve import STRAIGHT, VoltageCurve

PATH_UNIT = 10_000


class LastResort(StrEnum):
    """The action of an aMussel on its backup battery at the safe level, before it can no longer surface."""

    WAIT = "wait"
    """Stay on the bottom and listen."""
    CALL = "call"
    """Stay and send its status again and again."""
    SURFACE = "surface"
    """Come up without a permission, which it does in no other case."""


@dataclass(frozen=True, slots=True)
class Metering:
    """The battery monitor: voltage = curve(charge) - sag + lift + noise, all in grains of the scaled voltage.

    The curves of Table I and the equations are voltages of an idle board, so sag counts from that board's load.
    """

    period_ms: int
    """The monitor samples at whole multiples of this period."""
    settle_ms: int
    """A level counts once every sample over so long lies beyond it. It must be longer than a motor run, whose sag would
    count otherwise."""
    sag_ms: int = 0
    """Internal resistance: grains of voltage for each grain a millisecond of load above `sag_from`."""
    sag_from: int = 0
    lift: int = 0
    """The voltage rise while its charger gives."""
    noise: int = 0
    """Readings are off by up to so much either way, uniformly."""
    seed: int = 0
    """The noise is a keyed hash of (seed, agent id, number of the sample)."""
    curve: VoltageCurve = STRAIGHT

    def __post_init__(self) -> None:
        if self.period_ms <= 0 or min(self.settle_ms, self.sag_ms, self.sag_from, self.lift, self.noise) < 0:
            raise ValueError("period_ms must be positive, and nothing else of a Metering negative")


@dataclass(frozen=True, slots=True)
class Power:
    """Loads by module, two batteries, and the path between charger, batteries and board.

    `path` is the part of the load, in 1/10000, that reaches the feeding battery while it is charged: Table I's charging
    times do not superpose with its discharging times, so this is a parameter of its own.
    """

    loads: Loads
    path: int
    motor_run_ms: int
    receive_ms: int
    """The modem draws its receiving load so long for a packet; counted from the packet's end, which is when it acts."""
    switch_back: int
    """The board returns to the primary battery at this charge."""
    safe_level: int
    """The backup battery's level at which the board takes its last resort."""
    last_resort: LastResort
    kept_on: int = 0
    """Rails that nothing switches off, as bits."""
    metering: Metering | None = None
    """None: the board knows the charges exactly, and every level counts at once."""
    low_level: int = 0
    """The primary battery's level at which a sleeping board wakes; 0 for no such level."""
    secondary_in_use: bool = False
    """The board works on its secondary battery, too (the paper's section IV-A), down to the safe level if it has a last
    resort. Otherwise the secondary is a backup, on which the board only listens."""

    def __post_init__(self) -> None:
        if not 0 <= self.path <= PATH_UNIT:
            raise ValueError(f"path must lie in 0 to {PATH_UNIT}, not {self.path}")


def timeslots_of(agent_ids: Iterable[int]) -> dict[int, int]:
    """The number of each aMussel's timeslot: its place among the ids of the whole fleet, ascending."""
    return {agent_id: number for number, agent_id in enumerate(sorted(agent_ids))}


@dataclass(frozen=True, slots=True)
class Timeslots:
    """Acoustic timeslots, computed from the time alike on all boards; each board has one timeslot in every frame."""

    frame_ms: int
    slot_ms: int
    guard_ms: int = 0
    """A board transmits so long after its timeslot opens; with clock errors up to this, packets do not collide."""

    def __post_init__(self) -> None:
        if not 0 <= self.guard_ms < self.slot_ms <= self.frame_ms:
            raise ValueError("a guard must be shorter than its slot, and a slot not longer than the frame")

    @property
    def count(self) -> int:
        """The number of whole timeslots in a frame."""
        return self.frame_ms // self.slot_ms


@dataclass(frozen=True, slots=True)
class Cycle:
    """The board's sleep and its wakes. The alarm rings at whole multiples of its period."""

    alarm_ms: int
    sample_ms: int
    """The sensors are on for so long: the whole of a short wake."""
    processing_ms: int
    """The Pi works on the samples for so long; 0 for a wake without the Pi."""
    slots: Timeslots | None
    """The timeslots in which boards transmit; None if the board goes back to sleep instead."""
    listen_ms: int
    """The board stays awake for so long after it has come to rest on the bottom."""
    report_ms: int
    """The board stays awake in a dock for so long after its report, and after each acknowledgement of its log."""

    def __post_init__(self) -> None:
        if self.alarm_ms <= 0:
            raise ValueError("alarm_ms must be positive")


@dataclass(frozen=True, slots=True)
class Timekeeping:
    """The firmware's assumption about its clock, and its wait for a beacon."""

    bound_ppb: int
    """The crystal's largest drift by its data sheet, in parts of 10^9."""
    beacon_wait_ms: int
    """If the clock may be off by more than the guard, the board does not transmit but listens for a beacon so long."""

    def __post_init__(self) -> None:
        if self.bound_ppb < 0 or self.beacon_wait_ms <= 0:
            raise ValueError("bound_ppb must not be negative, and beacon_wait_ms positive")


@dataclass(frozen=True, slots=True)
class FullFirmware:
    """The whole firmware; a board without one is the paper's worst case: one battery, one load, never asleep."""

    power: Power
    cycle: Cycle | None
    """None for a board that never sleeps."""
    transmit_ms: int
    call_ms: int
    """The time between the calls of a last resort."""
    hover_ms: int
    """The time between the motor runs that hold a depth."""
    stay_down_ms: int = 21_600_000
    """After an order to sink, the board does not surface as a last resort for so long: 6 h."""
    timekeeping: Timekeeping | None = None
    """None for a board that trusts its clock."""
    turnaround_ms: int = 500
    """The time from a ping's end to the answer: the board wakes, reads its batteries, and commands its modem."""
    answer_ms: int = 393
    """The modem's transmission time of an answer: a v3 nanomodem's 7 bytes."""

    def __post_init__(self) -> None:
        if self.turnaround_ms < 0 or self.answer_ms <= 0:
            raise ValueError("turnaround_ms must not be negative, and answer_ms positive")


@dataclass(frozen=True, slots=True)
class BoardConfig:
    """The numbers of one board; milliseconds of agent time."""

    agent_id: int
    charge: ChargeModel
    pin_debounce_ms: int
    boot_ms: int
    float_timeout_ms: int
    release_wait_ms: int
    whole: FullFirmware | None = None
    """Sleep, rails and two batteries; None is the paper's worst case."""
    slot: int = 0
    """The index of this board's acoustic timeslot in every frame."""
    pin_chatter_ms: int = 2000
    """If the charger's pin bounces this long, the level that it held most of the time counts."""
    pin_check_ms: int = 60_000
    """The board samples the pin's level at whole multiples of this and at every wake, which finds a missed edge."""
    drift_ppb: int = 0
    """The gain of the board's clock on agent time, in parts of 10^9."""
    surfacing_timeout_ms: int = 180_000
    """A board that has not come up after so long gives the surfacing up."""

    motor_run: int = 0
    """Grains that one run of the buoyancy motors takes, from the backup battery as far as the primary lacks them; a whole
    board counts its motors' load."""

    def __post_init__(self) -> None:
        cycle = None if self.whole is None else self.whole.cycle
        if cycle is not None and cycle.slots is not None and not 0 <= self.slot < cycle.slots.count:
            raise ValueError(f"slot {self.slot} does not lie in a frame of {cycle.slots.count}")
        if self.surfacing_timeout_ms <= 0:
            raise ValueError("surfacing_timeout_ms must be positive")
        if not self.pin_debounce_ms < self.pin_chatter_ms or self.pin_check_ms <= 0:
            raise ValueError("pin_chatter_ms must be longer than pin_debounce_ms, and pin_check_ms positive")


def numbers_for_port(board: BoardConfig, whole: FullFirmware) -> tuple[int, ...]:
    """The numbers that firmware behind the port is told, as `native/board_config.h` lists them; 0 for an absent part."""
    cycle, timekeeping = whole.cycle, whole.timekeeping
    return (
        board.pin_chatter_ms,
        board.pin_check_ms,
        0 if cycle is None else cycle.processing_ms,
        0 if cycle is None else cycle.listen_ms,
        0 if cycle is None else cycle.report_ms,
        whole.transmit_ms,
        whole.call_ms,
        whole.hover_ms,
        whole.stay_down_ms,
        whole.turnaround_ms,
        whole.answer_ms,
        0 if timekeeping is None else timekeeping.bound_ppb,
        0 if timekeeping is None else timekeeping.beacon_wait_ms,
    )
