"""Somebody's firmware behind the port on a whole board: rails, sleep, a clock of its own, I2C, and flash."""

from __future__ import annotations

import struct
from collections.abc import Callable

from agents.mussel.firmware_failure import FirmwareFailed
from agents.mussel.port.board_link import BoardLink, FrameToBoard
from agents.mussel.port.peripherals import Address, ClockRegister, MeasuredWorld, Peripherals
from agents.mussel.port.port_firmware import PortFirmware
from firmware_model.actions import Action, Buoyancy, Dropped, FeedFrom, SendBytes, StateReported
from firmware_model.config import BoardConfig, FullFirmware, LastResort, numbers_for_port
from firmware_model.hardware.whole import WholeBoardHardware
from firmware_model.port import Level, Timer
from firmware_model.port_frames import (
    Frame,
    FromBoard,
    I2cResult,
    InputPin,
    SleepMode,
    ToBoard,
    Uart,
)
from firmware_model.power.active_battery import ActiveBattery
from firmware_model.power.rails import IDLE, Rail, bits
from firmware_model.states import State
from firmware_model.stimuli import ResetCause

_U16, _U32, _READ = struct.Struct("<H"), struct.Struct("<I"), struct.Struct("<IH")
_HERE = 0xFFFF_FFFF
_LAST_RESORTS = {LastResort.WAIT: 0, LastResort.CALL: 1, LastResort.SURFACE: 2}
_LINES = {
    Level.EMPTIED: InputPin.BATTERY_EMPTY,
    Level.SWITCH_BACK: InputPin.SWITCH_BACK,
    Level.SAFE_LEVEL: InputPin.SAFE_LEVEL,
    Level.LOW_LEVEL: InputPin.LOW_LEVEL,
}
_MODULES = (1 << len(Rail)) - 1 & ~bits(
    Rail.MU_ASLEEP, Rail.MU_ACTIVE, Rail.MODEM_RECEIVING, Rail.MODEM_TRANSMITTING, Rail.MOTORS
)
"""The rails that firmware switches. The others follow from its sleep, from packets and from runs of the motors."""
_SHORT_PACKET = 7
"""A modem sends up to so many bytes for as long as an answer takes, and more for as long as a status."""


class WholePortFirmware(PortFirmware):
    """A `PortFirmware` on the whole board's hardware."""

    _hardware: WholeBoardHardware

    def __init__(
        self,
        connect: Callable[[], BoardLink],
        config: BoardConfig,
        hardware: WholeBoardHardware,
        seed: int,
        world: MeasuredWorld,
        modem: int = 3,
    ) -> None:
        """`modem` is the nanomodem's generation."""
        super().__init__(connect, config, hardware, seed)
        assert config.whole is not None
        self._whole: FullFirmware = config.whole
        self._modem = modem
        self._peripherals = Peripherals(hardware, world)
        self._modules = IDLE & _MODULES
        self._sleep_mode = SleepMode.AWAKE
        self._clock_due_ms: int | None = None
        self._watchdog_ms: int | None = None

    def start(self, cause: ResetCause, now_ms: int) -> list[Action]:
        """After a reset the core is awake and the modem listens, if a battery feeds the board."""
        started = [*super().start(cause, now_ms), *self._switch(now_ms)]
        return started + self._go_dark(now_ms) if self._has_no_feed else started

    @property
    def _has_no_feed(self) -> bool:
        return self._hardware.feed is ActiveBattery.NEITHER

    def _go_dark(self, now_ms: int) -> list[Action]:
        """Ends the program: no code runs without power. Its board is made anew when a charger feeds it."""
        self.close()
        old, self.state = self.state, State.LOST
        return [*self._hardware.enter(self.state, 0, now_ms), StateReported(now_ms, old, self.state)]

    def next_timer(self) -> tuple[int | None, Timer]:
        if self.watchdog_fired:
            return None, Timer.DEADLINE
        times = (self._alarm_ms, self._clock_due_ms, self._watchdog_ms)
        return min((it for it in times if it is not None), default=None), Timer.DEADLINE

    def fire(self, timer: Timer, now_ms: int) -> list[Action]:
        if self._watchdog_ms is not None and self._watchdog_ms <= now_ms:
            self.watchdog_fired = True
            self.close()
            return []
        if self._clock_due_ms is not None and self._clock_due_ms <= now_ms:
            self._clock_due_ms = self._peripherals.alarm = None
            return self._turn(now_ms, (ToBoard.PIN, InputPin.CLOCK, b"\1"))
        return self._turn(now_ms)

    def report(self, now_ms: int) -> list[Action]:
        """Asks the firmware for the experiment's report."""
        return self._turn(now_ms, (ToBoard.PIN, InputPin.REPORT, b"\1"))

    def level_reached(self, level: Level | None, now_ms: int) -> list[Action]:
        if level is None:
            return []
        moved = level in (Level.EMPTIED, Level.SWITCH_BACK)
        feed: list[Action] = [FeedFrom(now_ms, self._hardware.feed)] if moved else []
        if self._has_no_feed:
            return feed + self._go_dark(now_ms)
        return feed + self._turn(now_ms, (ToBoard.PIN, _LINES[level], b"\1"))

    def clock_disturbed(self, now_ms: int) -> None:
        """The chip's alarm follows its reading; the firmware notices nothing."""
        self._set_clock_alarm(now_ms)

    def _set_clock_alarm(self, now_ms: int) -> None:
        alarm = self._peripherals.alarm
        self._clock_due_ms = None if alarm is None else max(now_ms, self._hardware.clock.when(alarm))

    def _turn(self, now_ms: int, interrupt: FrameToBoard | None = None) -> list[Action]:
        return [] if self.watchdog_fired else super()._turn(now_ms, interrupt)

    def _hello(self) -> FrameToBoard:
        whole, (kind, port, payload) = self._whole, super()._hello()
        numbers = numbers_for_port(self._config, whole)
        flags = (
            (whole.cycle is not None)
            | (whole.timekeeping is not None) << 1
            | whole.power.secondary_in_use << 2
        )
        last_resort = _LAST_RESORTS[whole.power.last_resort]
        more = struct.pack(
            f"<{len(numbers)}IHBBB", *numbers, whole.power.kept_on, flags, last_resort, self._modem
        )
        return kind, port, payload + more

    def _levels(self) -> int:
        hardware = self._hardware
        levels = {
            InputPin.SAFE_LEVEL: hardware.is_at_safe_level,
            InputPin.ON_SECONDARY: hardware.feed is ActiveBattery.SECONDARY,
        }
        return super()._levels() | sum(1 << line for line, high in levels.items() if high)

    def _switch(self, now_ms: int) -> list[Action]:
        core = Rail.MU_ACTIVE if self._sleep_mode is SleepMode.AWAKE else Rail.MU_ASLEEP
        return self._hardware.enter(self.state, self._modules | bits(core), now_ms)

    def _sleep(self, frame: Frame, now_ms: int) -> list[Action]:
        actions = super()._sleep(frame, now_ms)
        mode = frame.port >> 1
        if mode > SleepMode.DEEP:
            raise FirmwareFailed(f"it sleeps in mode {mode}, which is none")
        if mode != self._sleep_mode:
            self._sleep_mode = SleepMode(mode)
            actions += self._switch(now_ms)
        return actions

    def _take(self, frame: Frame, link: BoardLink, now_ms: int) -> list[Action]:
        payload, devices = frame.payload, self._peripherals
        match frame.kind:
            case FromBoard.I2C if payload:
                read, actions = self._transfer(frame.port, payload[1:], payload[0], now_ms)
                result = I2cResult.NO_ANSWER if read is None else I2cResult.DONE
                link.send([(ToBoard.I2C, result, read or b"")], now_ms)
                return actions
            case FromBoard.FLASH_READ if len(payload) == _READ.size:
                return self._flash(link, devices.flash_read(*_READ.unpack(payload)), now_ms)
            case FromBoard.FLASH_PROGRAM if len(payload) > _U32.size:
                at = _U32.unpack_from(payload)[0]
                return self._flash(link, devices.flash_program(at, payload[_U32.size :]), now_ms)
            case FromBoard.FLASH_ERASE if len(payload) == _U16.size:
                return self._flash(link, devices.flash_erase(_U16.unpack(payload)[0]), now_ms)
            case FromBoard.BUSY if len(payload) == _U32.size:
                return [*self._hardware.stay_awake(now_ms + _U32.unpack(payload)[0], now_ms)]
            case FromBoard.KICK if len(payload) == _U32.size:
                lasting_ms = _U32.unpack(payload)[0]
                self._watchdog_ms = now_ms + lasting_ms if lasting_ms else None
                return []
            case FromBoard.UART_TX:
                return self._send(frame, now_ms)
        return super()._take(frame, link, now_ms)

    def _flash(self, link: BoardLink, read: bytes | None, now_ms: int) -> list[Action]:
        link.send([(ToBoard.FLASH, read is None, read or b"")], now_ms)
        return []

    def _send(self, frame: Frame, now_ms: int) -> list[Action]:
        """Sends by a medium that has power. The modem draws its load while it sends, whatever the firmware does."""
        hardware, data = self._hardware, frame.payload
        match frame.port:
            case Uart.MODEM if self._modules >> Rail.MODEM_LISTENING & 1:
                whole = self._whole
                lasting_ms = whole.answer_ms if len(data) <= _SHORT_PACKET else whole.transmit_ms
                return [
                    *hardware.transmit(lasting_ms, now_ms),
                    SendBytes(now_ms, Rail.MODEM_TRANSMITTING, data),
                ]
            case Uart.WIFI if hardware.has_wifi:
                return [SendBytes(now_ms, Rail.WIFI, data)]
            case Uart.REPORT:
                return [SendBytes(now_ms, Rail.WIFI, data)]
            case Uart.MODEM:
                return [Dropped(now_ms, "the modem is off")]
            case Uart.WIFI:
                return [Dropped(now_ms, "Wi-Fi is off")]
        raise FirmwareFailed(f"it sent a frame that cannot be: type {frame.kind}, port {frame.port}")

    def _transfer(
        self, address: int, written: bytes, count: int, now_ms: int
    ) -> tuple[bytes | None, list[Action]]:
        hardware = self._hardware
        if address == Address.RAILS and not written:
            return _U16.pack(hardware.rails)[:count], []
        if address == Address.RAILS and len(written) == _U16.size:
            self._modules = _U16.unpack(written)[0] & _MODULES
            return b"", self._switch(now_ms)
        if address == Address.MOTORS and len(written) == _U32.size:
            depth_mm = _U32.unpack(written)[0]
            return b"", self._run_motors(Buoyancy.HOVER, None if depth_mm == _HERE else depth_mm, now_ms)
        read = self._peripherals.transfer(address, written, count, now_ms)
        if address == Address.CLOCK and written[0:1] in (
            bytes([ClockRegister.TIME]),
            bytes([ClockRegister.ALARM]),
        ):
            self._set_clock_alarm(now_ms)
        return read, []

    def _run_motors(self, to: Buoyancy, depth_mm: int | None, now_ms: int) -> list[Action]:
        return [*super()._run_motors(to, depth_mm, now_ms), *self._switch(now_ms)]
