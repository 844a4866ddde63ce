"""Boards whose batteries or loads differ from the nominal: by age, or one by one. The charge scale stays [0, 1].

An aged battery discharges and charges faster on the scale of voltage: every rate is divided by the remaining capacity.
Both batteries of an aMussel age alike here.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from firmware_model.config import BoardConfig
from firmware_model.power.rails import Loads

AS_NEW = 10_000
"""The whole capacity, in 1/10000."""


@dataclass(frozen=True, slots=True)
class Fading:
    """The loss of capacity, in 1/10000 of the capacity as new.

    Lithium polymer cells are sold for 300 to 500 full cycles to 80 %, and lose a few percent a year on the shelf.
    """

    per_100_cycles: int = 400
    per_year: int = 300

    def __post_init__(self) -> None:
        if min(self.per_100_cycles, self.per_year) < 0:
            raise ValueError("a battery does not gain by ageing")


def capacity_left(cycles: int, years: float, fading: Fading | None = None) -> int:
    """The remaining capacity in 1/10000 of that as new. ValueError when nothing is left, or for a negative age."""
    fading = Fading() if fading is None else fading
    if cycles < 0 or years < 0:
        raise ValueError("an age is not negative")
    left = AS_NEW - cycles * fading.per_100_cycles // 100 - round(years * fading.per_year)
    if left <= 0:
        raise ValueError(f"nothing is left of a battery after {cycles} cycles and {years:g} years")
    return left


def aged(config: BoardConfig, capacity: int) -> BoardConfig:
    """The board on batteries with `capacity` of 10000 of the capacity as new; every rate rounded down."""
    if not 0 < capacity <= AS_NEW:
        raise ValueError(f"a capacity lies in 1 to {AS_NEW}, not {capacity}")
    return rescaled(config, AS_NEW, capacity)


def rescaled(config: BoardConfig, drain: int, capacity: int) -> BoardConfig:
    """The board with `drain` of 10000 of its loads, on batteries with `capacity` of 10000; every rate rounded down.

    ValueError when either is not positive.
    """
    if min(drain, capacity) <= 0:
        raise ValueError(f"a drain and a capacity are positive, not {drain} and {capacity}")

    def faster(rate: int) -> int:
        return rate * AS_NEW // capacity

    def drawn(rate: int) -> int:
        return rate * drain // capacity

    charge = config.charge.rescaled(drain, capacity, AS_NEW)
    whole = config.whole
    if whole is not None:
        power, metering = whole.power, whole.power.metering
        if metering is not None:
            # The resistance stays, and with it the voltage drop under a current.
            metering = replace(
                metering,
                sag_ms=metering.sag_ms * capacity // AS_NEW,
                sag_from=faster(metering.sag_from),
            )
        loads = Loads(tuple(drawn(load) for load in power.loads.of))
        whole = replace(whole, power=replace(power, loads=loads, metering=metering))
    return replace(config, charge=charge, whole=whole)
