"""The port between the hardware of an MU board and its firmware: the calls in each direction.

`Hardware` is everything that firmware may ask of the board: it decides nothing. `Firmware` is everything that reaches a
program on the board: it decides, and never sees a charge, a drift or a place. `firmware_model.board.Board` joins the two,
and neither imports the other. Each call happens at `now_ms` of agent time; one that changes something on the board returns
what changed, for the trace.
"""

from __future__ import annotations

from collections.abc import Sequence
from enum import IntEnum
from typing import Protocol

from firmware_model.actions import Action, Buoyancy
from firmware_model.power.active_battery import ActiveBattery
from firmware_model.power.rails import Rail
from firmware_model.settings import Settings
from firmware_model.states import State
from firmware_model.stimuli import ResetCause


class Timer(IntEnum):
    """The timers of a board, in the order in which those due together fire."""

    PIN = 0
    """Firmware: an edge of the charger's pin becomes certain, or is looked for."""
    BATTERIES = 1
    """Hardware: a battery reaches a level."""
    PULSE = 2
    """Hardware: a rail that was on for a stated time goes off."""
    DEADLINE = 3
    """Firmware: the state ends by itself."""
    ANSWER = 4
    """Firmware: the modem answers a ping."""


class Level(IntEnum):
    """An interrupt of the battery monitor: a level that a battery reached; several at one time count in this order."""

    EMPTIED = 0
    """The feeding battery is empty: another one feeds the board from now on, or neither."""
    SWITCH_BACK = 1
    """The primary, while the charger feeds the board through the secondary: the primary feeds the board again."""
    SAFE_LEVEL = 2
    """The backup, feeding the board: soon the aMussel may be unable to surface."""
    LOW_LEVEL = 3
    """The primary, feeding the board."""


class ClockChip(Protocol):
    """The board's clock: a crystal that runs a little fast or slow, with an alarm and a cell of its own."""

    def reading_at(self, now_ms: int) -> int:
        """The clock's reading in milliseconds."""

    def when(self, reading_ms: int) -> int:
        """Sets an alarm: the time at which the clock will read so much or more."""

    def doubt_ms(self, at_ms: int, bound_ppb: int) -> int:
        """The largest error of the clock at `at_ms`, if crystals of its kind drift by up to `bound_ppb` of 10^9."""

    def set(self, reading_ms: int, now_ms: int) -> None: ...


class Hardware(Protocol):
    """The side of the board that firmware calls."""

    @property
    def pin_high(self) -> bool:
        """The level of the charger's pin, not debounced."""

    @property
    def at_surface(self) -> bool:
        """True if the pressure sensor reads the surface."""

    @property
    def feed(self) -> ActiveBattery:
        """The position of the switch between the batteries."""

    def enter(self, state: State, rails: int, now_ms: int) -> Sequence[Action]:
        """Sets the switches for a state just entered; `rails` are its modules, as bits.

        A board with rails switches them. The worst case has one load: there the state arms the charger and the monitor.
        """

    def run_motors(self, to: Buoyancy, depth_mm: int | None, now_ms: int) -> Action:
        """Starts a run of the buoyancy motors, or tells that no battery holds its charge."""


class WholeHardware(Hardware, Protocol):
    """The side that only the whole board has: rails, a clock of its own, and a battery monitor with levels."""

    @property
    def clock(self) -> ClockChip: ...

    @property
    def stored(self) -> Settings:
        """The settings in flash; as delivered, if nothing was ever stored."""

    def store(self, settings: Settings) -> None: ...

    @property
    def is_at_safe_level(self) -> bool:
        """True while the backup battery feeds the board and is known to be at its safe level or below."""

    def is_on(self, *rails: Rail) -> bool:
        """True if any of `rails` is on."""

    def stay_awake(self, until_ms: int, now_ms: int) -> Sequence[Action]:
        """Keeps the microcontroller up until then, in a state that sleeps."""

    def transmit(self, lasting_ms: int, now_ms: int) -> Sequence[Action]:
        """The modem transmits for so long; meanwhile it receives nothing."""

    def watch_levels(self, levels: tuple[int, int, int], now_ms: int) -> None:
        """Sets the monitor's switch-back, safe and low levels, in grains."""


class FirmwareLike(Protocol):
    """The program on a board: ours, or somebody else's in a process of its own."""

    @property
    def state(self) -> State: ...

    @property
    def reset_cause(self) -> ResetCause | None: ...

    @property
    def watchdog_fired(self) -> bool:
        """True once the board is to be reset, because the program did not serve its watchdog in time."""

    @property
    def clock_offset_ms(self) -> int:
        """The clock minus the last beacon's time, as the firmware noted it then; within 32 bits."""

    def next_timer(self) -> tuple[int | None, Timer]:
        """The firmware's next timer and its time; None for none."""

    def fire(self, timer: Timer, now_ms: int) -> list[Action]:
        """Takes the timer that is due."""

    def start(self, cause: ResetCause, now_ms: int) -> list[Action]:
        """The MCU left reset."""

    def pin_changed(self, noticed: bool, now_ms: int) -> list[Action]:
        """The charger's pin has another level; `noticed` is False if the edge's interrupt was lost."""

    def depth_changed(self, now_ms: int) -> list[Action]:
        """The pressure sensor noticed the surface or the bottom."""

    def sound_received(self, data: bytes, now_ms: int) -> list[Action]:
        """The acoustic modem delivered bytes."""

    def wifi_received(self, data: bytes, now_ms: int) -> list[Action]: ...

    def level_reached(self, level: Level | None, now_ms: int) -> list[Action]:
        """The battery monitor's interrupt; None for a check in between that found nothing."""

    def power_changed(self, now_ms: int) -> None:
        """Rails or charger changed without the firmware."""

    def clock_disturbed(self, now_ms: int) -> None:
        """The clock's reading or rate changed by itself."""

    def close(self) -> None:
        """Ends what the program has outside of the board: its process, or a serial line. Nothing more is asked of it."""
