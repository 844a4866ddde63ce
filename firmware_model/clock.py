"""The MU's own clock: a crystal that runs a little fast or slow, its alarms, and its setting by a beacon.

Everything is counted in whole milliseconds and parts of 10^9, so that a reading does not depend on how often it is taken.
The clock has a cell of its own: a reset of the MU does not change it.
"""

from __future__ import annotations

from dataclasses import dataclass

BILLION = 10**9


@dataclass(frozen=True, slots=True)
class Clock:
    """An anchor: the clock read `reading_ms` at agent time `anchor_ms`, and has gained `drift_ppb` parts of 10^9 since."""

    anchor_ms: int
    reading_ms: int
    drift_ppb: int

    def __post_init__(self) -> None:
        if abs(self.drift_ppb) >= BILLION:
            raise ValueError(f"a drift of {self.drift_ppb} of 10^9 is no clock's")

    def reading_at(self, now_ms: int) -> int:
        """The reading at agent time `now_ms`, rounded down; ValueError before the anchor."""
        elapsed_ms = now_ms - self.anchor_ms
        if elapsed_ms < 0:
            raise ValueError(f"time went back: {now_ms} before {self.anchor_ms}")
        return self.reading_ms + elapsed_ms + elapsed_ms * self.drift_ppb // BILLION

    def when(self, reading_ms: int) -> int:
        """The first agent time, from the anchor on, at which the clock reads `reading_ms` or more."""
        ahead_ms = reading_ms - self.reading_ms
        return self.anchor_ms + max(0, -(-ahead_ms * BILLION // (BILLION + self.drift_ppb)))

    def doubt_ms(self, now_ms: int, bound_ppb: int) -> int:
        """The largest error at `now_ms`, if a crystal of its kind drifts by up to `bound_ppb`; rounded up."""
        return -(-(now_ms - self.anchor_ms) * bound_ppb // BILLION)

    def set(self, reading_ms: int, now_ms: int) -> Clock:
        """The same crystal, set to read `reading_ms` at `now_ms`."""
        return Clock(now_ms, reading_ms, self.drift_ppb)


class AlarmClock:
    """A clock with an alarm at whole multiples of a period, by its own reading. No multiple rings twice."""

    def __init__(self, clock: Clock, now_ms: int) -> None:
        self.clock = clock
        self.corrected_ms = 0
        """The clock minus the last beacon's time; negative if the clock was behind."""
        self._passed_ms = clock.reading_at(now_ms)
        """Alarms up to this reading have rung, or are skipped."""

    def reading_at(self, now_ms: int) -> int:
        return self.clock.reading_at(now_ms)

    def pass_over(self, now_ms: int) -> None:
        """Skips the alarms up to now that have not rung."""
        self._passed_ms = max(self._passed_ms, self.clock.reading_at(now_ms))

    def alarm_ms(self, period_ms: int, now_ms: int) -> int:
        """The agent time of the next alarm: now, if the clock was set past it."""
        return max(now_ms, self.clock.when(self._next(period_ms)))

    def rang(self, period_ms: int) -> None:
        """Marks the next alarm as rung."""
        self._passed_ms = self._next(period_ms)

    def _next(self, period_ms: int) -> int:
        return (self._passed_ms // period_ms + 1) * period_ms

    def set(self, reading_ms: int, now_ms: int) -> None:
        """Sets the clock by a beacon."""
        self.corrected_ms = self.clock.reading_at(now_ms) - reading_ms
        self.clock = self.clock.set(reading_ms, now_ms)
