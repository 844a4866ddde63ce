"""What an aPad may change on a board by its commands. It is kept in flash: neither a reset nor a flat battery ends it.

What of a whole board outlives a reset, beside its batteries: its clock, which has a cell of its own, and its flash.
"""

from __future__ import annotations

from dataclasses import dataclass

from firmware_model.clock import AlarmClock, Clock
from firmware_model.config import BoardConfig
from firmware_model.packets import SetThreshold, SleepSchedule, SlotAssignment
from firmware_model.power.charge import FULL


@dataclass(frozen=True, slots=True)
class Settings:
    """Milliseconds by the board's own clock; levels in grains."""

    alarm_ms: int
    """Of a board that sleeps; 0 of one that never does."""
    sample_ms: int
    frame_ms: int
    """0: it has no timeslot."""
    slot_ms: int
    guard_ms: int
    slot: int
    offset_ms: int
    """Added to where the slot says to speak: learned from how long sound takes, and negative to make up for that."""
    safe_level: int
    switch_back: int
    low_level: int

    @classmethod
    def of(cls, config: BoardConfig) -> Settings:
        """What a board has before anybody told it anything. The paper's worst case has none (AssertionError)."""
        whole = config.whole
        assert whole is not None
        cycle, power = whole.cycle, whole.power
        slots = None if cycle is None else cycle.slots
        return cls(
            0 if cycle is None else cycle.alarm_ms,
            0 if cycle is None else cycle.sample_ms,
            0 if slots is None else slots.frame_ms,
            0 if slots is None else slots.slot_ms,
            0 if slots is None else slots.guard_ms,
            config.slot,
            0,
            power.safe_level,
            power.switch_back,
            power.low_level,
        )

    @property
    def has_slot(self) -> bool:
        return self.frame_ms > 0

    @property
    def levels(self) -> tuple[int, int, int]:
        """To switch back at, the safe one, the low one."""
        return self.switch_back, self.safe_level, self.low_level

    def speaks_at_ms(self, reading_ms: int) -> int:
        """The first reading from `reading_ms` on at which it may speak: in slot arithmetic on the absolute time."""
        first_ms = self.slot * self.slot_ms + self.guard_ms + self.offset_ms
        return first_ms - (first_ms - reading_ms) // self.frame_ms * self.frame_ms

    def told(self, command: SleepSchedule | SlotAssignment | SetThreshold) -> Settings | None:
        """With what the command asks for; None when that cannot be."""
        match command:
            case SleepSchedule(_, alarm_ms, wake_ms):
                if self.alarm_ms == 0 or not 0 < wake_ms < alarm_ms:
                    return None
                return self._with(alarm_ms=alarm_ms, sample_ms=wake_ms)
            case SlotAssignment(_, frame_ms, slot_ms, guard_ms, slot, offset_ms):
                if slot_ms == 0 or (slot + 1) * slot_ms > frame_ms or guard_ms >= slot_ms:
                    return None
                return self._with(
                    frame_ms=frame_ms, slot_ms=slot_ms, guard_ms=guard_ms, slot=slot, offset_ms=offset_ms
                )
            case SetThreshold(_, which, value):
                return self._with(**{which.name.lower(): round(value * FULL)})

    def _with(self, **changes: int) -> Settings:
        """`dataclasses.replace`, which does not know the lean classes of an agent's process."""
        return Settings(*(changes.get(name, getattr(self, name)) for name in self.__match_args__))


@dataclass(frozen=True, slots=True)
class StoredSettings:
    """The clock's anchor in agent time, what it read then, and what commands made of the settings."""

    anchor_ms: int
    reading_ms: int
    settings: Settings


class SettingsStore:
    """The clock and the settings of a running board."""

    def __init__(self, config: BoardConfig, kept: StoredSettings | None, now_ms: int) -> None:
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
        self.kept = StoredSettings(clock.anchor_ms, clock.reading_ms, self.settings)
