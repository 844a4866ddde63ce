"""The devices on a whole board's I2C bus and its flash, for firmware in a process of its own.

docs/firmware-port.md has each device's bytes. A device without power, or one that takes no such bytes, does not answer.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum
from typing import Protocol

from firmware_model.hardware.whole import WholeBoardHardware
from firmware_model.power.charge import FULL, fraction
from firmware_model.power.rails import SENSOR_RAILS
from firmware_model.sampling.flash import Flash
from firmware_model.sampling.sensors import Counts
from firmware_model.settings import Settings

_COUNTS = struct.Struct("<HB")
_PLACE = struct.Struct("<iiH")
_CHARGES = struct.Struct("<II")
_LEVEL = struct.Struct("<BH")
_SETTINGS = struct.Struct("<IIIIIHi")
_U32, _U64 = struct.Struct("<I"), struct.Struct("<Q")
_NEVER = (1 << 64) - 1


class Address(IntEnum):
    RAILS = 0x20
    """The switches of the rails. Firmware handles it, because the core's own rail follows from its sleep."""
    BATTERY_MONITOR = 0x36
    SENSOR = 0x40
    """The first sensor of the table; the others follow."""
    PLACE = 0x48
    SETTINGS = 0x50
    MOTORS = 0x60
    CLOCK = 0x68


class ClockRegister(IntEnum):
    TIME = 0
    ALARM = 8
    SAMPLES = 16
    ACKNOWLEDGED = 20
    AGE = 24
    """ms since the clock was set; it can only be read."""


class MeasuredBody(Protocol):
    """The body around a board, as devices on its bus measure it."""

    def known_place_cm(self, now_ms: int) -> tuple[int, int, int]:
        """North, east and depth, as the aMussel knows them."""


@dataclass(slots=True)
class MeasuredWorld:
    """The part of the world that a board's devices measure, and the registers and flash that outlive a reset."""

    flash: Flash
    body: MeasuredBody
    sensors: Callable[[int, int], tuple[Counts, int] | None]
    """The counts of all sensors at an agent time for the sample of a number, and a bit for each that is out of range; None
    while they do not answer."""
    samples: int = 0
    acknowledged: int = 0

    @property
    def registers(self) -> tuple[int, int]:
        """The number of samples ever taken, and the sequence below which all were acknowledged."""
        return self.samples, self.acknowledged


class Peripherals:
    """The devices that only measure or keep. `alarm` is the reading at which the clock chip interrupts; None for never."""

    def __init__(self, hardware: WholeBoardHardware, world: MeasuredWorld) -> None:
        self._hardware = hardware
        self.world = world
        self.alarm: int | None = None

    def transfer(self, address: int, written: bytes, count: int, now_ms: int) -> bytes | None:
        """Writes to the device at `address` and reads `count` bytes from it; None if it does not answer."""
        match address:
            case Address.BATTERY_MONITOR:
                read = self._monitor(written, now_ms)
            case Address.PLACE if not written:
                read = _PLACE.pack(*self.world.body.known_place_cm(now_ms))
            case Address.SETTINGS:
                read = self._settings(written)
            case Address.CLOCK if written:
                read = self._clock(written[0], written[1:], now_ms)
            case _ if not written and 0 <= address - Address.SENSOR < len(SENSOR_RAILS):
                read = self._sensor(address - Address.SENSOR, now_ms)
            case _:
                read = None
        return None if read is None or count > len(read) else read[:count]

    def _sensor(self, place: int, now_ms: int) -> bytes | None:
        if not self._hardware.is_on(SENSOR_RAILS[place]):
            return None
        if (measured := self.world.sensors(now_ms, self.world.samples)) is None:
            return None
        counts, saturated = measured
        return _COUNTS.pack(counts[place], saturated >> place & 1)

    def _monitor(self, written: bytes, now_ms: int) -> bytes | None:
        hardware = self._hardware
        if not written:
            primary, secondary = (
                round(fraction(grains) * 0xFFFF_FFFF) for grains in hardware.readings(now_ms)
            )
            return _CHARGES.pack(primary, secondary)
        if len(written) != _LEVEL.size or written[0] > 2:
            return None
        which, value = _LEVEL.unpack(written)
        stored = hardware.stored
        levels = [stored.safe_level, stored.switch_back, stored.low_level]
        levels[which] = round(value / 0xFFFF * FULL)
        safe_level, switch_back, low_level = levels
        changed = self._changed(safe_level=safe_level, switch_back=switch_back, low_level=low_level)
        hardware.watch_levels(changed.levels, now_ms)
        hardware.store(changed)
        return b""

    def _settings(self, written: bytes) -> bytes | None:
        stored = self._hardware.stored
        if not written:
            return _SETTINGS.pack(
                stored.alarm_ms,
                stored.sample_ms,
                stored.frame_ms,
                stored.slot_ms,
                stored.guard_ms,
                stored.slot,
                stored.offset_ms,
            )
        if len(written) != _SETTINGS.size:
            return None
        names = Settings.__match_args__[:7]
        self._hardware.store(self._changed(**dict(zip(names, _SETTINGS.unpack(written), strict=True))))
        return b""

    def _changed(self, **changes: int) -> Settings:
        stored = self._hardware.stored
        return Settings(*(changes.get(name, getattr(stored, name)) for name in Settings.__match_args__))

    def _clock(self, register: int, written: bytes, now_ms: int) -> bytes | None:
        world, hardware = self.world, self._hardware
        if not written:
            alarm = _NEVER if self.alarm is None else self.alarm
            chip = _U64.pack(hardware.clock.reading_at(now_ms)) + _U64.pack(alarm)
            chip += _U32.pack(world.samples) + _U32.pack(world.acknowledged)
            chip += _U64.pack(now_ms - hardware.clock.anchor_ms)
            return chip[register:]
        match register:
            case ClockRegister.TIME if len(written) == _U64.size:
                hardware.clock.set(_U64.unpack(written)[0], now_ms)
                hardware.store(hardware.stored)
            case ClockRegister.ALARM if len(written) == _U64.size:
                alarm = _U64.unpack(written)[0]
                self.alarm = None if alarm == _NEVER else alarm
            case ClockRegister.SAMPLES if len(written) == _U32.size:
                world.samples = _U32.unpack(written)[0]
            case ClockRegister.ACKNOWLEDGED if len(written) == _U32.size:
                world.acknowledged = _U32.unpack(written)[0]
            case _:
                return None
        return b""

    def flash_read(self, at: int, size: int) -> bytes | None:
        """Bytes of the flash; None outside of it."""
        flash = self.world.flash
        return flash.read(at, size) if at + size <= flash.pages * flash.page_bytes else None

    def flash_program(self, at: int, data: bytes) -> bytes | None:
        """Programs bytes of one page that are erased; None for others, of which nothing changes, and for a failed write."""
        flash = self.world.flash
        page, offset = divmod(at, flash.page_bytes)
        if page >= flash.pages or offset + len(data) > flash.page_bytes or any(flash.read(at, len(data))):
            return None
        flash.program(at, data)
        return b"" if flash.read(at, len(data)) == data else None

    def flash_erase(self, page: int) -> bytes | None:
        if page >= self.world.flash.pages:
            return None
        self.world.flash.erase(page)
        return b""
