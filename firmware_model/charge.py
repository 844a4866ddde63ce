"""Battery charge on the paper's scaled voltage range, counted in integers so that no cutting of time shows.

Equations (1) and (2) of the paper are per simulated minute. One full battery is `FULL` grains, chosen so that a rate
with ten decimals a minute is a whole number of grains a millisecond. Charge moves as the paper's own difference
equation does, with a step of one millisecond; the closed forms below equal that iteration exactly.
"""

from __future__ import annotations

from dataclasses import dataclass
from decimal import Decimal
from enum import IntEnum

_DECIMALS = 10
_MS_PER_MIN = 60_000
FULL: int = 10**_DECIMALS * _MS_PER_MIN
"""Grains in a battery at 1.0, that is 4200 mV."""
EMPTY_MV = 3600
FULL_MV = 4200


def grains(fraction: float) -> int:
    """The charge fraction in [0, 1] as grains; decimal, so that 0.5634 is exact."""
    return int(Decimal(repr(fraction)) * FULL)


def grains_per_ms(per_minute: float) -> int:
    """A rate of the paper, in fractions a minute, as whole grains a millisecond (ValueError past ten decimals)."""
    scaled = Decimal(repr(per_minute)) * 10**_DECIMALS
    if scaled != int(scaled) or scaled <= 0:
        raise ValueError(f"a rate must be positive with at most {_DECIMALS} decimals, not {per_minute}")
    return int(scaled)


class Flow(IntEnum):
    """Where a battery's charge is going."""

    RESTING = 0
    DISCHARGING = 1
    CHARGING = 2


@dataclass(frozen=True, slots=True)
class Battery:
    """An anchor: `charge` grains at `anchor_ms`, flowing as `flow` since. It moves only at events."""

    anchor_ms: int
    charge: int
    flow: Flow


@dataclass(frozen=True, slots=True)
class ChargeModel:
    """Discharge at one rate (equation (1)) and a piecewise-linear charging curve (equation (2)).

    `segments` are (upper end in grains, grains a millisecond), rising, the last ending at `FULL`. A charge that lies on
    an end still moves at that segment's rate, as in equation (2).
    """

    discharge: int
    segments: tuple[tuple[int, int], ...]

    @classmethod
    def from_minutes(cls, discharge: float, segments: tuple[tuple[float, float], ...]) -> ChargeModel:
        """From rates a simulated minute and ends on [0, 1], as the paper prints them."""
        return cls(
            grains_per_ms(discharge), tuple((grains(end), grains_per_ms(rate)) for end, rate in segments)
        )

    def charge_at(self, battery: Battery, now_ms: int) -> int:
        """Grains at `now_ms`, clamped to [0, FULL]."""
        elapsed_ms = now_ms - battery.anchor_ms
        if elapsed_ms < 0:
            raise ValueError(f"time went back: {now_ms} before {battery.anchor_ms}")
        if battery.flow is Flow.RESTING:
            return battery.charge
        if battery.flow is Flow.DISCHARGING:
            return max(0, battery.charge - self.discharge * elapsed_ms)
        charge = battery.charge
        for end, rate in self.segments:
            if charge > end:
                continue
            steps = (end - charge) // rate + 1
            if steps >= elapsed_ms:
                return min(FULL, charge + rate * elapsed_ms)
            charge += rate * steps
            elapsed_ms -= steps
        return min(FULL, charge)

    def settle(self, battery: Battery, now_ms: int, flow: Flow) -> Battery:
        """A new anchor at `now_ms`, flowing as `flow` from there."""
        return Battery(now_ms, self.charge_at(battery, now_ms), flow)

    def empty_at_ms(self, battery: Battery) -> int | None:
        """The first millisecond at which a discharging battery stands at 0; None when it is not discharging."""
        if battery.flow is not Flow.DISCHARGING:
            return None
        return battery.anchor_ms - (-battery.charge // self.discharge)

    def reaches_at_ms(self, battery: Battery, target: int) -> int | None:
        """The first millisecond at which a charging battery holds `target` grains or more; None when it never does."""
        if battery.charge >= target:
            return battery.anchor_ms
        if battery.flow is not Flow.CHARGING or target > FULL:
            return None
        charge, at_ms = battery.charge, battery.anchor_ms
        for end, rate in self.segments:
            if charge > end:
                continue
            if target <= end:
                return at_ms - (-(target - charge) // rate)
            steps = (end - charge) // rate + 1
            charge += rate * steps
            at_ms += steps
            if charge >= target:
                return at_ms
        return at_ms


def fraction(charge: int) -> float:
    """Grains as the paper's scaled voltage in [0, 1]."""
    return charge / FULL


def millivolts(charge: int) -> int:
    """Grains as terminal voltage on the paper's permitted range, 3600 to 4200 mV."""
    return EMPTY_MV + (FULL_MV - EMPTY_MV) * charge // FULL
