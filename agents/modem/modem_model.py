"""A modem's model: its firmware's command set, and the numbers that the manual leaves to the device."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

from agents.modem.frames import ModemGeneration

RELEASE = "001.006.000"
BUILT = "2024-02-15T00:00:00"
"""The manual's own date; the hour is not public."""


class ModemFirmware(Enum):
    """V2 modems of 2016 to 2018; early V3; V3 with firmware 1.6.0, whose manual the rest of this package follows."""

    V2 = "v2"
    V3_EARLY = "v3-early"
    V3 = "v3"

    @property
    def generation(self) -> ModemGeneration:
        return ModemGeneration.V2 if self is ModemFirmware.V2 else ModemGeneration.V3


@dataclass(frozen=True, slots=True)
class ModemConfig:
    """`answer_wait_ms` is the manual's 4 s for `#TO`. The turnaround before an answer is assumed; it is not public."""

    firmware: ModemFirmware = ModemFirmware.V3
    answer_wait_ms: int = 4000
    turnaround_ms: int = 5
    unique_id: int = 0
    """The chip's 96-bit serial number; `$D` shows it."""
    supply_mv: int = 5000
    lines: int = 1
    """Serial lines; a real modem has one. Each line gets the answers to its own commands; all get the received frames."""


def voltage_steps(firmware: ModemFirmware, supply_mv: int) -> int:
    """The number y printed for a voltage: V = y x 15 / 65536 in V3, y x 1.1 x 6 / 1024 (10 bits) in V2."""
    if firmware is ModemFirmware.V2:
        return min(1023, (supply_mv * 1024 * 10 + 33_000) // 66_000)
    return min(65535, (supply_mv * 65536 + 7_500) // 15_000)


def range_steps(one_way_us: float) -> int:
    """The number t printed for a range of t x c x 3.125e-5 m: the one-way time in steps of 31.25 us."""
    return min(99_999, round(one_way_us / 31.25))


def metres_of(steps: int, sound_speed_m_s: float = 1500.0) -> float:
    """The range in m of a printed t, by the manual's t x c x 3.125e-5. Its c is 1500 m/s."""
    return steps * sound_speed_m_s * 3.125e-5
