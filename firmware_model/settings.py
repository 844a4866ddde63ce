"""The settings of a board that an aPad's commands change. Flash keeps them through a reset and a flat battery.

Beside the batteries, two parts of a whole board outlive a reset: its clock, which has a cell of its own, and its flash.
"""

from __future__ import annotations

from dataclasses import dataclass

from firmware_model.config import BoardConfig
from firmware_model.packets import SetThreshold, SleepSchedule, SlotAssignment
from firmware_model.power.charge import FULL


@dataclass(frozen=True, slots=True)
class Settings:
    """Milliseconds by the board's own clock; levels in grains."""

    alarm_ms: int
    """The period of the wakes; 0 for a board that never sleeps."""
    sample_ms: int
    frame_ms: int
    """0 for a board without a timeslot."""
    slot_ms: int
    guard_ms: int
    slot: int
    offset_ms: int
    """Added to the transmission time of the timeslot; negative to compensate the measured travel time of sound."""
    safe_level: int
    switch_back: int
    low_level: int

    @classmethod
    def of(cls, config: BoardConfig) -> Settings:
        """The settings of a board before any command. The paper's worst case has none (AssertionError)."""
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
    def has_timeslot(self) -> bool:
        return self.frame_ms > 0

    @property
    def levels(self) -> tuple[int, int, int]:
        """The switch-back level, the safe level and the low level."""
        return self.switch_back, self.safe_level, self.low_level

    def transmits_at_ms(self, reading_ms: int) -> int:
        """The first clock reading from `reading_ms` on at which the board may transmit, computed from absolute time."""
        first_ms = self.slot * self.slot_ms + self.guard_ms + self.offset_ms
        return first_ms - (first_ms - reading_ms) // self.frame_ms * self.frame_ms

    def changed_by(self, command: SleepSchedule | SlotAssignment | SetThreshold) -> Settings | None:
        """The settings after `command`; None if the command is impossible."""
        match command:
            case SleepSchedule(_, alarm_ms, wake_ms):
                if self.alarm_ms == 0 or not 0 < wake_ms < alarm_ms:
                    return None
                return self._replaced(alarm_ms=alarm_ms, sample_ms=wake_ms)
            case SlotAssignment(_, frame_ms, slot_ms, guard_ms, slot, offset_ms):
                if slot_ms == 0 or (slot + 1) * slot_ms > frame_ms or guard_ms >= slot_ms:
                    return None
                return self._replaced(
                    frame_ms=frame_ms, slot_ms=slot_ms, guard_ms=guard_ms, slot=slot, offset_ms=offset_ms
                )
            case SetThreshold(_, which, value):
                return self._replaced(**{which.name.lower(): round(value * FULL)})

    def _replaced(self, **changes: int) -> Settings:
        """Does the work of `dataclasses.replace`, which does not know the lean classes of an agent's process."""
        return Settings(*(changes.get(name, getattr(self, name)) for name in self.__match_args__))


@dataclass(frozen=True, slots=True)
class StoredSettings:
    """The clock's anchor in agent time, its reading then, and the settings after all commands."""

    anchor_ms: int
    reading_ms: int
    settings: Settings
