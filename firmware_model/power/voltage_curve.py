"""The voltage of a battery by its charge, both scaled to [0, FULL] grains: straight pieces between points."""

from __future__ import annotations

from bisect import bisect_right
from dataclasses import dataclass
from functools import cached_property

from firmware_model.power.charge import FULL

Points = tuple[tuple[int, int], ...]


@dataclass(frozen=True)
class VoltageCurve:
    """`points` are (charge, voltage), both rising, from a charge of 0 to FULL. Beyond them the outer pieces go on.

    A full battery's voltage under the load at which the curve was taken may lie below FULL.
    """

    points: Points = ((0, 0), (FULL, FULL))

    def __post_init__(self) -> None:
        charges, voltages = zip(*self.points, strict=True)
        rising = all(list(it) == sorted(set(it)) for it in (charges, voltages))
        if not rising or (charges[0], charges[-1]) != (0, FULL):
            raise ValueError("the charges and the voltages of a curve rise, and the charges from 0 to 1")

    def voltage(self, charge: int) -> int:
        """The voltage in grains."""
        return charge if self.is_straight else _along(self.points, charge)

    def charge(self, voltage: int) -> int:
        """The charge in grains, the inverse of `voltage` but for rounding."""
        return voltage if self.is_straight else _along(self._turned, voltage)

    @property
    def stretch(self) -> float:
        """The greatest change of the charge for a change of the voltage."""
        return max(self.stretch_at(voltage) for _, voltage in self.points[:-1])

    def stretch_at(self, voltage: int) -> float:
        """The change of the charge for a change of this voltage."""
        (low, before), (high, after) = _piece(self._turned, voltage)
        return (after - before) / (high - low)

    @cached_property
    def is_straight(self) -> bool:
        return all(charge == voltage for charge, voltage in self.points)

    @cached_property
    def _turned(self) -> Points:
        return tuple((voltage, charge) for charge, voltage in self.points)


STRAIGHT = VoltageCurve()
"""The paper's: charge is the scaled voltage."""


def _piece(points: Points, at: int) -> tuple[tuple[int, int], tuple[int, int]]:
    after = min(max(bisect_right(points, at, key=_first), 1), len(points) - 1)
    return points[after - 1], points[after]


def _first(point: tuple[int, int]) -> int:
    return point[0]


def _along(points: Points, at: int) -> int:
    (x, y), (far_x, far_y) = _piece(points, at)
    return y + (at - x) * (far_y - y) // (far_x - x)
