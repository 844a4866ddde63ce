"""Facts that reach the board from outside, in the past tense."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum


class ResetCause(IntEnum):
    POWER_ON = 0
    BROWN_OUT = 1
    WATCHDOG = 2


@dataclass(frozen=True, slots=True)
class PowerCameOn:
    """The MCU left reset. `at_surface` comes from the pressure sensor, `pin_high` is the charger pin's level."""

    cause: ResetCause
    at_surface: bool
    pin_high: bool


@dataclass(frozen=True, slots=True)
class ChargePinRose:
    """The charger's pin went high: raw, not yet debounced. `noticed` is False when the edge's interrupt was lost.

    `powered` is False for a level that no charger raised, so that nothing flows.
    """

    noticed: bool = True
    powered: bool = True


@dataclass(frozen=True, slots=True)
class ChargePinFell:
    """The charger's pin went low: raw, not yet debounced. `noticed` is False when the edge's interrupt was lost."""

    noticed: bool = True


@dataclass(frozen=True, slots=True)
class PacketHeard:
    """The acoustic modem delivered these bytes."""

    data: bytes


@dataclass(frozen=True, slots=True)
class ModemSpoke:
    """The modem began to transmit by itself, without the board: the answer to a ping for its range."""

    lasting_ms: int


@dataclass(frozen=True, slots=True)
class WifiReceived:
    data: bytes


@dataclass(frozen=True, slots=True)
class SurfaceReached:
    """The pressure sensor reads the surface."""


@dataclass(frozen=True, slots=True)
class BottomReached:
    """The pressure sensor stopped rising: the aMussel rests on the bottom."""


@dataclass(frozen=True, slots=True)
class ChargeVanished:
    """The batteries lost these charges at once (grains), by a defect; at most what they held."""

    primary: int
    secondary: int


@dataclass(frozen=True, slots=True)
class ClockJumped:
    """The clock's reading changed by `by_ms`, by a defect: the board does not notice."""

    by_ms: int


@dataclass(frozen=True, slots=True)
class ClockSkewed:
    """The crystal runs this much faster than as delivered from now on (parts of 10^9; negative: slower); 0 as delivered."""

    skew_ppb: int


@dataclass(frozen=True, slots=True)
class ConverterDisturbed:
    """The converter's readings of the batteries scatter by up to `noise` grains either way, by a defect; 0 heals it.

    `holds`: it holds its present readings, until it is disturbed without.
    """

    noise: int
    holds: bool = False


Stimulus = (
    PowerCameOn
    | ChargePinRose
    | ChargePinFell
    | PacketHeard
    | ModemSpoke
    | WifiReceived
    | SurfaceReached
    | BottomReached
    | ChargeVanished
    | ClockJumped
    | ClockSkewed
    | ConverterDisturbed
)
