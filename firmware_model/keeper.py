"""What of a whole board outlives a reset, beside its batteries: its clock, which has a cell of its own, and its flash."""

from __future__ import annotations

from dataclasses import dataclass

from firmware_model.clock import AlarmClock, Clock
from firmware_model.config import BoardConfig
from firmware_model.packets import SetThreshold, SleepSchedule, SlotAssignment
from firmware_model.settings import Settings


@dataclass(frozen=True, slots=True)
class Kept:
    """The clock's anchor in agent time, what it read then, and what commands made of the settings."""

    anchor_ms: int
    reading_ms: int
    settings: Settings


class Keeper:
    """The clock and the settings of a running board."""

    def __init__(self, config: BoardConfig, kept: Kept | None, now_ms: int) -> None:
        """`kept` None: as delivered, the clock set when the aMussel was put into the water, at agent time 0."""
        self.kept = kept
        anchor_ms, reading_ms = (0, 0) if kept is None else (kept.anchor_ms, kept.reading_ms)
        self.clock = AlarmClock(Clock(anchor_ms, reading_ms, config.drift_ppb), now_ms)
        self.settings = Settings.of(config) if kept is None else kept.settings

    def set_clock(self, reading_ms: int, now_ms: int) -> None:
        self.clock.set(reading_ms, now_ms)
        self._keep()

    def told(self, command: SleepSchedule | SlotAssignment | SetThreshold, now_ms: int) -> bool:
        """Whether the command can be obeyed; if so, it is, and kept."""
        settings = self.settings.told(command)
        if settings is None:
            return False
        self.settings = settings
        self.clock.pass_over(now_ms)  # another period's alarms begin now
        self._keep()
        return True

    def _keep(self) -> None:
        clock = self.clock.clock
        self.kept = Kept(clock.anchor_ms, clock.reading_ms, self.settings)
