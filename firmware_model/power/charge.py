"""Battery charge on the paper's scaled voltage range, counted in integers so that any division of time gives one result.

Equations (1) and (2) of the paper are per simulated minute. A full battery is `FULL` grains, chosen so that a rate with
ten decimals a minute is a whole number of grains a millisecond. Charge follows the paper's own difference equation with a
step of one millisecond; the closed forms below equal that iteration exactly.

While a charger feeds a battery that also supplies a load, the net rate may be too low to leave a segment of the curve, or
negative. A charge that would rise into a segment in which it falls rests at the end between the two.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from decimal import Decimal
from enum import IntEnum

from firmware_model.value import value

_DECIMALS = 10
MS_PER_MIN = 60_000
MS_PER_HOUR = 60 * MS_PER_MIN
FULL: int = 10**_DECIMALS * MS_PER_MIN
"""Grains in a battery at 1.0, that is 4200 mV."""
EMPTY_MV = 3600
FULL_MV = 4200
_FOREVER = 1 << 62


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
    """The direction of a battery's charge."""

    RESTING = 0
    DISCHARGING = 1
    CHARGING = 2


@value
class Battery:
    """An anchor: `charge` grains at `anchor_ms`, flowing as `flow` since. It moves only at events.

    `load` is drawn from the battery, in grains a millisecond, on top of the model's own discharge; `coils` is the number of
    coils that charge it, one or two.
    """

    anchor_ms: int
    charge: int
    flow: Flow
    load: int = 0
    coils: int = 1


Segments = tuple[tuple[int, int], ...]


@dataclass(frozen=True, slots=True)
class ChargeModel:
    """Discharge at one rate (equation (1)) and a piecewise-linear charging curve (equation (2)).

    `segments` are (upper end in grains, grains a millisecond), rising, the last ending at `FULL`. A charge that lies on
    an end still moves at that segment's rate, as in equation (2). `discharge` is equation (1)'s rate if it contains every
    load, and 0 if loads are counted by module; `segments_by_two` is the curve of a charger with two coils.
    """

    discharge: int
    segments: Segments
    segments_by_two: Segments = ()

    @classmethod
    def from_minutes(cls, discharge: float, segments: tuple[tuple[float, float], ...]) -> ChargeModel:
        """Makes a model of rates a simulated minute and ends on [0, 1], as the paper prints them; one coil."""
        return cls(
            grains_per_ms(discharge), tuple((grains(end), grains_per_ms(rate)) for end, rate in segments)
        )

    def rescaled(self, drain: int, capacity: int, whole: int) -> ChargeModel:
        """The model of batteries with `capacity` of `whole` of this capacity, under `drain` of its own discharge.

        Every rate is rounded down.
        """

        def curve(segments: Segments) -> Segments:
            return tuple((end, rate * whole // capacity) for end, rate in segments)

        return ChargeModel(
            self.discharge * drain // capacity, curve(self.segments), curve(self.segments_by_two)
        )

    def charge_at(self, battery: Battery, now_ms: int) -> int:
        """Grains at `now_ms`, clamped to [0, FULL]."""
        elapsed_ms = now_ms - battery.anchor_ms
        if elapsed_ms < 0:
            raise ValueError(f"time went back: {now_ms} before {battery.anchor_ms}")
        if battery.flow is Flow.RESTING:
            return battery.charge
        if battery.flow is Flow.DISCHARGING:
            return max(0, battery.charge - (self.discharge + battery.load) * elapsed_ms)
        for at_ms, last_ms, charge, rate in self._pieces(battery):
            if now_ms <= last_ms:
                return charge + rate * (now_ms - at_ms)
        raise AssertionError("the last piece lasts for ever")

    def settle(self, battery: Battery, now_ms: int, flow: Flow, load: int = 0) -> Battery:
        """A new anchor at `now_ms`, flowing as `flow` under `load` from there."""
        return Battery(now_ms, self.charge_at(battery, now_ms), flow, load, battery.coils)

    def empty_at_ms(self, battery: Battery) -> int | None:
        """The first millisecond at which a discharging battery is at 0; None if nothing is drawn from it."""
        rate = self.discharge + battery.load
        if battery.flow is not Flow.DISCHARGING or rate == 0:
            return None
        return battery.anchor_ms - (-battery.charge // rate)

    def falls_to_at_ms(self, battery: Battery, target: int) -> int | None:
        """The first millisecond at which a battery holds `target` grains or fewer; None when it never does."""
        for at_ms, last_ms, charge, rate in self._pieces(battery):
            if charge <= target:
                return at_ms
            if rate < 0 and (found_ms := at_ms - (charge - target) // rate) <= last_ms:
                return found_ms
        return None

    def reaches_at_ms(self, battery: Battery, target: int) -> int | None:
        """The first millisecond at which a battery holds `target` grains or more; None when it never does."""
        for at_ms, last_ms, charge, rate in self._pieces(battery):
            if charge >= target:
                return at_ms
            if rate > 0 and (found_ms := at_ms - (charge - target) // rate) <= last_ms:
                return found_ms
        return None

    def _pieces(self, battery: Battery) -> Iterator[tuple[int, int, int, int]]:
        """The course as linear pieces (from ms, to ms, grains at the start, grains a millisecond); the last has no end."""
        at_ms, charge = battery.anchor_ms, battery.charge
        if battery.flow is Flow.RESTING:
            yield at_ms, _FOREVER, charge, 0
            return
        if battery.flow is Flow.DISCHARGING:
            segments: Segments = ((FULL, 0),)
            load = self.discharge + battery.load
        else:
            segments = self.segments if battery.coils == 1 else self.segments_by_two
            load = battery.load
        while True:
            low, end, rate = _segment(segments, charge)
            rate -= load
            # The number of milliseconds for which the charge stays in this segment.
            if rate > 0:
                steps = (end - charge) // rate
            elif rate < 0:
                steps = (charge - low - 1) // -rate
            else:
                steps = _FOREVER
            if steps >= 0:
                yield at_ms, min(_FOREVER, at_ms + steps), charge, rate
            if rate == 0:
                return
            at_ms += steps + 1
            charge += rate * (steps + 1)
            if charge >= FULL or charge <= 0:
                charge = min(FULL, max(0, charge))
                if charge == 0 and _segment(segments, 0)[2] > load:
                    continue
                yield at_ms, _FOREVER, charge, 0
                return
            if rate > 0 and _segment(segments, charge)[2] <= load:
                yield at_ms, _FOREVER, end, 0
                return


def _segment(segments: Segments, charge: int) -> tuple[int, int, int]:
    """(lower end, upper end, charger's rate) of the segment of `charge`; the lower end does not belong to it."""
    low = 0
    for end, rate in segments:
        if charge <= end:
            return low, end, rate
        low = end
    raise ValueError(f"a charge of {charge} lies above the curve's end")


def fraction(charge: int) -> float:
    """Grains as the paper's scaled voltage in [0, 1]."""
    return charge / FULL


def volts(fraction: float) -> float:
    """The paper's scaled voltage in [0, 1] as terminal voltage."""
    return (EMPTY_MV + (FULL_MV - EMPTY_MV) * fraction) / 1000


def millivolts(charge: int) -> int:
    """Grains as terminal voltage on the paper's permitted range, 3600 to 4200 mV."""
    return EMPTY_MV + (FULL_MV - EMPTY_MV) * charge // FULL
