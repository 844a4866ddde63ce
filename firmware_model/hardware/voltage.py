"""The battery monitor's readings, which differ from the charge, and the board's conclusions from them.

`power_path.py` decides if a board reports these or its charge.

A load lowers the voltage for as long as it lasts, a charger lifts it, and a reading has noise. The monitor samples at whole
multiples of its period; a load that changes at a sample's own time changes after the sample. A level counts once every
sample over `settle_ms` was beyond it: so the sag of a transmission, or a charger's touch for a moment, has no effect.
"""

from __future__ import annotations

import math
from struct import Struct

from firmware_model.config import Metering
from firmware_model.keyed_hash import blake2b
from firmware_model.power.charge import FULL, Battery, ChargeModel, Flow

_KEY = Struct("<QQQ").pack
_WORDS = Struct("<QQ").unpack
_LOOKAHEAD_SAMPLES = 64
"""The number of samples that are tested in one go; where noise decides, the board tests again after so many."""


class Meter:
    """Readings of one board's two batteries, in grains; `which` is 0 for the primary and 1 for the secondary."""

    def __init__(self, model: ChargeModel, metering: Metering, agent_id: int) -> None:
        self.model = model
        self.metering = metering
        self._agent_id = agent_id
        self.needed = metering.settle_ms // metering.period_ms + 1
        """The number of consecutive samples that make a conclusion."""

    def offset(self, battery: Battery) -> int:
        """The lift less the sag of `battery`, at its present flow and load."""
        metering = self.metering
        sag = metering.sag_ms * max(0, battery.load - metering.sag_from)
        return (metering.lift if battery.flow is Flow.CHARGING else 0) - sag

    def voltage(self, battery: Battery, at_ms: int) -> int:
        """The voltage without noise. A charger never lifts it above `FULL`; under load it may be below 0."""
        charge = self.model.charge_at(battery, at_ms)
        return min(FULL, self.metering.curve.voltage(charge) + self.offset(battery))

    def noise(self, which: int, n: int) -> int:
        """The noise of sample `n`: uniform on the integers of [-noise, +noise], and always the same for a sample."""
        words: tuple[int, int] = _WORDS(
            blake2b(_KEY(self.metering.seed, self._agent_id, n), digest_size=16).digest()
        )
        return (words[which] * (2 * self.metering.noise + 1) >> 64) - self.metering.noise

    def reading(self, battery: Battery, which: int, n: int) -> int:
        """The reading of sample `n`, at n periods."""
        return self.voltage(battery, n * self.metering.period_ms) + self.noise(which, n)


class Watch:
    """Counts the consecutive samples at a level or beyond it, from the first one after `now_ms` on."""

    def __init__(self, meter: Meter, which: int, level: int, rising: bool, now_ms: int) -> None:
        self._meter = meter
        self._which = which
        self._level = level
        self._sign = 1 if rising else -1
        self._counted = now_ms // meter.metering.period_ms
        self._run = 0

    def count(self, battery: Battery, until_ms: int) -> bool:
        """Counts the samples up to `until_ms`, all on the course of `battery`; returns True if they make a conclusion."""
        n = until_ms // self._meter.metering.period_ms
        until, run = n, 0
        while n > self._counted and run < self._meter.needed and self._beyond(battery, n):
            run += 1
            n -= 1
        self._run = self._run + run if n == self._counted else run
        self._counted = until
        return self._run >= self._meter.needed

    def due_ms(self, battery: Battery) -> int | None:
        """The time of the next count: a conclusion, or a useful check; None if this course leads to no conclusion."""
        period_ms, needed = self._meter.metering.period_ms, self._meter.needed
        n, run = self._counted + 1, self._run
        for _ in range(max(_LOOKAHEAD_SAMPLES, needed)):
            if self._margin(battery, n) < -self._meter.metering.noise:
                if (possible_ms := self._possible_ms(battery, n * period_ms)) is None:
                    return None
                n, run = -(-possible_ms // period_ms), 0
            run = run + 1 if self._beyond(battery, n) else 0
            if run >= needed:
                break
            n += 1
        return n * period_ms

    def _margin(self, battery: Battery, n: int) -> int:
        """The distance of the noiseless voltage beyond the level at sample `n`; negative if it is not beyond."""
        return self._sign * (self._meter.voltage(battery, n * self._meter.metering.period_ms) - self._level)

    def _beyond(self, battery: Battery, n: int) -> bool:
        margin, noise = self._margin(battery, n), self._meter.metering.noise
        if not -noise <= margin < noise:
            return margin >= noise
        return margin + self._sign * self._meter.noise(self._which, n) >= 0

    def _possible_ms(self, battery: Battery, from_ms: int) -> int | None:
        """The first time from `from_ms` on at which the voltage is so near the level that noise may take it beyond."""
        model = self._meter.model
        here = Battery(from_ms, model.charge_at(battery, from_ms), battery.flow, battery.load, battery.coils)
        metering = self._meter.metering
        voltage = self._level - self._meter.offset(battery) - self._sign * metering.noise
        # The inverse is rounded, so a curve's charge is reached sooner by its steepest piece.
        early = 0 if metering.curve.is_straight else math.ceil(metering.curve.stretch) + 1
        target = metering.curve.charge(voltage) - self._sign * early
        if self._sign < 0:
            return model.falls_to_at_ms(here, target)
        return model.reaches_at_ms(here, target) if self._level - self._meter.metering.noise <= FULL else None
