"""The firmware's use of its clock: alarms at whole multiples of a period, and the setting by a beacon."""

from __future__ import annotations

from firmware_model.port import ClockChip


class AlarmClock:
    """A clock with an alarm at whole multiples of a period, by its own reading.

    No multiple rings twice, unless the clock is set back by more than a period: then the count begins anew.
    """

    def __init__(self, clock: ClockChip, now_ms: int) -> None:
        self.clock = clock
        self.corrected_ms = 0
        """The clock minus the last beacon's time; negative if the clock was behind."""
        self._passed_ms = clock.reading_at(now_ms)
        """Alarms up to this reading have rung, or are skipped."""

    def reading_at(self, now_ms: int) -> int:
        return self.clock.reading_at(now_ms)

    def pass_over(self, period_ms: int, now_ms: int) -> None:
        """Skips the alarms up to now that have not rung."""
        self._count_anew_if_set_back(period_ms, now_ms)
        self._passed_ms = max(self._passed_ms, self.clock.reading_at(now_ms))

    def alarm_ms(self, period_ms: int, now_ms: int) -> int:
        """The agent time of the next alarm: now, if the clock was set past it."""
        return max(now_ms, self.clock.when(self._next(period_ms)))

    def rang(self, period_ms: int) -> None:
        """Marks the next alarm as rung."""
        self._passed_ms = self._next(period_ms)

    def _next(self, period_ms: int) -> int:
        return (self._passed_ms // period_ms + 1) * period_ms

    def set(self, reading_ms: int, period_ms: int, now_ms: int) -> None:
        """Sets the clock by a beacon."""
        self.corrected_ms = self.clock.reading_at(now_ms) - reading_ms
        self.clock.set(reading_ms, now_ms)
        self._count_anew_if_set_back(period_ms, now_ms)

    def _count_anew_if_set_back(self, period_ms: int, now_ms: int) -> None:
        reading_ms = self.clock.reading_at(now_ms)
        if self._passed_ms - reading_ms > period_ms:
            self._passed_ms = reading_ms
