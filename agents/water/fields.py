"""The water's true values at a sensor: oxygen, temperature, turbidity, and the pressure of its depth."""

from __future__ import annotations

from _blake2 import blake2b
from dataclasses import dataclass
from struct import Struct
from typing import Protocol

from firmware_model.sampling.sensors import Values

SURFACE_MBAR = 1013.25
"""The standard atmosphere."""
MBAR_PER_M = 1025 * 9.80665 / 100
"""Sea water of 1025 kg/m3."""

_KEY = Struct("<QQQ").pack
_WORDS = Struct("<32H").unpack
_SUMMED = 8
_MEAN = _SUMMED * 65535 / 2
_DEVIATION = (_SUMMED * (65536**2 - 1) / 12) ** 0.5


class Field(Protocol):
    def value_at(self, north_um: int, east_um: int, depth_um: int, now_ms: int) -> float:
        """The value in the unit of its quantity, at agent time `now_ms`. Equal arguments always give equal values."""
        ...


@dataclass(frozen=True, slots=True)
class Constant:
    """The same value everywhere and always."""

    value: float

    def value_at(self, north_um: int, east_um: int, depth_um: int, now_ms: int) -> float:
        return self.value


@dataclass(frozen=True, slots=True)
class Fields:
    """The fields of one water, in mg/l, degrees Celsius and NTU."""

    oxygen: Field
    temperature: Field
    turbidity: Field

    def values_at(self, north_um: int, east_um: int, depth_um: int, now_ms: int) -> Values:
        """The values in the order of `firmware_model.sampling.sensors.Quantity`."""
        at = (north_um, east_um, depth_um, now_ms)
        return (
            self.oxygen.value_at(*at),
            SURFACE_MBAR + MBAR_PER_M * depth_um / 1e6,
            self.temperature.value_at(*at),
            self.turbidity.value_at(*at),
        )


def unit_noises(seed: int, agent_id: int, sequence: int) -> Values:
    """The noise of an agent's sample number `sequence`: four independent numbers of mean 0 and variance 1.

    Each is the scaled sum of eight 16-bit words of a keyed hash: bell-shaped, within 4.9, and exact on every machine.
    """
    digest = blake2b(_KEY(seed, agent_id, sequence), digest_size=64, person=b"sensors").digest()
    words = _WORDS(digest)
    one, two, three, four = (
        (sum(words[at : at + _SUMMED]) - _MEAN) / _DEVIATION for at in range(0, len(words), _SUMMED)
    )
    return one, two, three, four
