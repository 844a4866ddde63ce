"""The water's true value of each quantity that a sensor measures, and the noise of its readings."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from struct import Struct
from typing import Protocol

from firmware_model.keyed_hash import blake2b
from firmware_model.sampling.sensors import SENSORS, Values

SURFACE_MBAR = 1013.25
"""The standard atmosphere."""
MBAR_PER_M = 1025 * 9.80665 / 100
"""Sea water of 1025 kg/m3."""

_KEY = Struct("<QQQ").pack
_WORDS = Struct("<32H").unpack
_SUMMED = 8
_AT_ONCE = 4
"""The numbers of noise in one hash."""
_MEAN = _SUMMED * 65535 / 2
_DEVIATION = (_SUMMED * (65536**2 - 1) / 12) ** 0.5


class Field(Protocol):
    def value_at(self, north_um: int, east_um: int, depth_um: int, now_ms: int) -> float:
        """The value in the unit of its quantity, at agent time `now_ms`. Equal arguments always give equal values."""


@dataclass(frozen=True, slots=True)
class Constant:
    """The same value everywhere and always."""

    value: float

    def value_at(self, north_um: int, east_um: int, depth_um: int, now_ms: int) -> float:
        return self.value


@dataclass(frozen=True, slots=True)
class Hydrostatic:
    """The absolute pressure at a depth, in mbar: the standard atmosphere's and that of sea water."""

    def value_at(self, north_um: int, east_um: int, depth_um: int, now_ms: int) -> float:
        return SURFACE_MBAR + MBAR_PER_M * depth_um / 1e6


BY_DEPTH: Mapping[str, Field] = {"pressure_mbar": Hydrostatic()}
"""The quantities that follow from the depth, by their sensors' keys."""


@dataclass(frozen=True, slots=True)
class WaterFields:
    """The fields of one water: one for each sensor of the table, in its order."""

    of: tuple[Field, ...]

    @classmethod
    def by_key(cls, fields: Mapping[str, Field]) -> WaterFields:
        """`fields` are by the sensors' keys, of all quantities that do not follow from the depth; KeyError otherwise."""
        return cls(tuple([BY_DEPTH[it.key] if it.calm is None else fields[it.key] for it in SENSORS]))

    def values_at(self, north_um: int, east_um: int, depth_um: int, now_ms: int) -> Values:
        """The values in the order of `firmware_model.sampling.sensors.SENSORS`."""
        return tuple([field.value_at(north_um, east_um, depth_um, now_ms) for field in self.of])


def unit_noises(seed: int, agent_id: int, sequence: int) -> Values:
    """The noise of an agent's sample number `sequence`: for each sensor an independent number of mean 0 and variance 1.

    Each is the scaled sum of eight 16-bit words of a keyed hash: bell-shaped, within 4.9, and exact on every machine.
    """
    key, noises = _KEY(seed, agent_id, sequence), list[float]()
    for block in range(-(-len(SENSORS) // _AT_ONCE)):
        person = b"sensors" if block == 0 else b"sensors%d" % block
        words = _WORDS(blake2b(key, digest_size=64, person=person).digest())
        noises += [
            (sum(words[at : at + _SUMMED]) - _MEAN) / _DEVIATION for at in range(0, len(words), _SUMMED)
        ]
    return tuple(noises[: len(SENSORS)])
