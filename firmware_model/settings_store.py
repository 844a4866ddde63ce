"""The settings of a running board, which its firmware reads from flash, changes and writes back.

`hardware/whole.py` keeps what outlives a reset.
"""

from __future__ import annotations

from firmware_model.clock import AlarmClock
from firmware_model.packets import SetThreshold, SleepSchedule, SlotAssignment
from firmware_model.port import WholeHardware


class SettingsStore:
    """The settings of a running board, and its use of the clock."""

    def __init__(self, hardware: WholeHardware, now_ms: int) -> None:
        self._hardware = hardware
        self.clock = AlarmClock(hardware.clock, now_ms)
        self.settings = hardware.stored

    def set_clock(self, reading_ms: int, now_ms: int) -> None:
        self.clock.set(reading_ms, self.settings.alarm_ms, now_ms)
        self._hardware.store(self.settings)

    def pass_alarms(self, now_ms: int) -> None:
        """Skips the alarms up to now that have not rung."""
        self.clock.pass_over(self.settings.alarm_ms, now_ms)

    def apply(self, command: SleepSchedule | SlotAssignment | SetThreshold, now_ms: int) -> bool:
        """Applies and stores the command; returns False if it is impossible."""
        if (settings := self.settings.changed_by(command)) is None:
            return False
        self.settings = settings
        self.pass_alarms(now_ms)  # the alarms of the new period begin now
        self._hardware.store(settings)
        return True
