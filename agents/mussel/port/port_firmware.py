"""Somebody's firmware behind the port: it decides on a board whose hardware stays here.

One turn is a write of what happened and of RUN, and a read up to the board's SLEEP; the rules are those of
docs/firmware-port.md. The link to the firmware is made with the first turn, and not with the board: a nursery makes boards
before it forks the agents that they belong to.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

from agents.mussel.firmware_failure import FirmwareFailed
from agents.mussel.port.board_link import TURN_TIMEOUT_S, BoardLink, FrameToBoard, serial_line
from firmware_model.actions import Action, Buoyancy, Dropped, SendBytes, StateReported
from firmware_model.config import BoardConfig
from firmware_model.hardware.worst_case import WorstCaseHardware
from firmware_model.port import Level, Timer
from firmware_model.port_frames import (
    MOST_FRAMES,
    VERSION,
    Frame,
    FromBoard,
    InputPin,
    OutputPin,
    ToBoard,
    Uart,
    alarm_ms,
)
from firmware_model.power.charge import fraction
from firmware_model.power.rails import Rail
from firmware_model.states import STATE_OF, State
from firmware_model.stimuli import ResetCause

if TYPE_CHECKING:
    from firmware_model.hardware.whole import WholeBoardHardware

_HELLO = struct.Struct("<HHIIIIII")
_ANSWER = struct.Struct("<H")
_COUNTER = struct.Struct("<I")
_RAIL_OF = {Uart.MODEM: Rail.MODEM_TRANSMITTING, Uart.WIFI: Rail.WIFI}


def link_to(command: Sequence[str], timeout_s: float = TURN_TIMEOUT_S) -> BoardLink:
    """A link to a program and its arguments, or to a real board on the serial line that `serial_line` reads from it."""
    # Imported here: a fleet of programs needs no pyserial, and one of real boards no processes.
    if (line := serial_line(command[0])) is None:
        from agents.mussel.port.firmware_process import FirmwareChild, FirmwareProcess

        return FirmwareProcess(FirmwareChild(command), timeout_s)
    from agents.mussel.port.serial_board import SerialBoard

    return SerialBoard(*line, timeout_s)


class PortFirmware:
    """A `firmware_model.port.FirmwareLike` behind a link, on the hardware of the paper's worst case.

    `whole_port_firmware` has the rest of a whole board.
    """

    _hardware: WorstCaseHardware | WholeBoardHardware

    clock_offset_ms = 0
    watchdog_fired = False

    def __init__(
        self,
        connect: Callable[[], BoardLink],
        config: BoardConfig,
        hardware: WorstCaseHardware | WholeBoardHardware,
        seed: int,
    ) -> None:
        """`connect` makes the link, and may raise FirmwareFailed. `seed` is the run's."""
        self.state = State.OFF
        self.reset_cause: ResetCause | None = None
        self._connect = connect
        self._config = config
        self._hardware = hardware
        self._seed = seed
        self._alarm_ms: int | None = None
        self._link: BoardLink | None = None
        self._frames = self._counted_ms = 0
        """The board's frames so far at this agent time: turns that never let time advance are a livelock."""
        self._outputs = dict.fromkeys(OutputPin, 0)

    @property
    def pid(self) -> int | None:
        """The firmware's process; None before the first turn, and for a real board."""
        return None if self._link is None else self._link.pid

    def close(self) -> None:
        """Ends the link, and a process at its other end."""
        if self._link is not None:
            self._link.close()

    def start(self, cause: ResetCause, now_ms: int) -> list[Action]:
        """The MCU left reset; the process begins with the first timer, which is due at once."""
        self.reset_cause = cause
        old, self.state = self.state, State.BOOTING
        self._alarm_ms = now_ms
        return [StateReported(now_ms, old, self.state)]

    def next_timer(self) -> tuple[int | None, Timer]:
        return self._alarm_ms, Timer.DEADLINE

    def fire(self, timer: Timer, now_ms: int) -> list[Action]:
        return self._turn(now_ms)

    def pin_changed(self, noticed: bool, now_ms: int) -> list[Action]:
        """An edge whose interrupt was lost wakes nobody; the level is in the next RUN."""
        if not noticed:
            return []
        return self._turn(now_ms, (ToBoard.PIN, InputPin.CHARGER, bytes([self._hardware.pin_high])))

    def depth_changed(self, now_ms: int) -> list[Action]:
        line = InputPin.SURFACE if self._hardware.at_surface else InputPin.BOTTOM
        return self._turn(now_ms, (ToBoard.PIN, line, b"\1"))

    def sound_received(self, data: bytes, now_ms: int) -> list[Action]:
        return self._turn(now_ms, (ToBoard.UART_RX, Uart.MODEM, data))

    def wifi_received(self, data: bytes, now_ms: int) -> list[Action]:
        return self._turn(now_ms, (ToBoard.UART_RX, Uart.WIFI, data))

    def level_reached(self, level: Level | None, now_ms: int) -> list[Action]:
        return self._turn(now_ms, (ToBoard.PIN, InputPin.BATTERY_EMPTY, b"\1"))

    def power_changed(self, now_ms: int) -> None:
        """The worst case has no rails."""

    def clock_disturbed(self, now_ms: int) -> None:
        """The worst case has no clock of its own."""

    def _turn(self, now_ms: int, interrupt: FrameToBoard | None = None) -> list[Action]:
        """Tells the board what happened, lets it run, and takes what it does until it sleeps, or FirmwareFailed."""
        link = self._link
        if link is None:
            # The program begins in a turn of its own, whatever happens at the same time: a turn has one interrupt at most.
            link = self._link = self._connect()
            assert self.reset_cause is not None
            begun = self._exchange(link, now_ms, (ToBoard.RESET, 0, bytes([self.reset_cause])), self._hello())
            return begun if interrupt is None else begun + self._turn(now_ms, interrupt)
        return self._exchange(link, now_ms, interrupt)

    def _exchange(
        self,
        link: BoardLink,
        now_ms: int,
        interrupt: FrameToBoard | None = None,
        hello: FrameToBoard | None = None,
    ) -> list[Action]:
        """One turn, before the first of which stands the bench's HELLO."""
        head, interrupts = ([] if it is None else [it] for it in (hello, interrupt))
        run = (ToBoard.RUN, 0, bytes([self._levels(), len(interrupts)]))
        link.send([*head, run, *interrupts], now_ms)
        self._alarm_ms = None
        actions: list[Action] = []
        if now_ms != self._counted_ms:
            self._frames, self._counted_ms = 0, now_ms
        while True:
            for frame in link.receive():
                self._frames += 1
                if self._frames > MOST_FRAMES:
                    raise FirmwareFailed(f"{MOST_FRAMES} frames at one time of its counter", by_watchdog=True)
                if frame.kind == FromBoard.SLEEP:
                    return actions + self._sleep(frame, now_ms)
                actions += self._take(frame, link, now_ms)

    def _hello(self) -> FrameToBoard:
        config = self._config
        hello = _HELLO.pack(
            VERSION,
            config.agent_id,
            self._seed & 0xFFFF_FFFF,
            config.pin_debounce_ms,
            config.boot_ms,
            config.surfacing_timeout_ms,
            config.float_timeout_ms,
            config.release_wait_ms,
        )
        return ToBoard.HELLO, 0, hello

    def _levels(self) -> int:
        hardware = self._hardware
        levels = {
            InputPin.CHARGER: hardware.pin_high,
            InputPin.SURFACE: hardware.at_surface,
            InputPin.BOTTOM: not hardware.at_surface,
        }
        return sum(1 << line for line, high in levels.items() if high)

    def _sleep(self, frame: Frame, now_ms: int) -> list[Action]:
        if frame.port & 1:
            if len(frame.payload) != _COUNTER.size:
                raise FirmwareFailed("it sent a SLEEP of another length")
            self._alarm_ms = alarm_ms(_COUNTER.unpack(frame.payload)[0], now_ms)
        return []

    def _take(self, frame: Frame, link: BoardLink, now_ms: int) -> list[Action]:
        """Carries out one frame of the board."""
        payload = frame.payload
        match frame.kind:
            case FromBoard.HELLO if len(payload) >= _ANSWER.size:
                if (version := _ANSWER.unpack_from(payload)[0]) != VERSION:
                    raise FirmwareFailed(f"it speaks version {version} of the port, and not {VERSION}")
                return []
            case FromBoard.PIN if frame.port in self._outputs and len(payload) == 1:
                return self._pin(OutputPin(frame.port), payload[0] != 0, now_ms)
            case FromBoard.UART_TX if frame.port in _RAIL_OF:
                return [SendBytes(now_ms, _RAIL_OF[Uart(frame.port)], payload)]
            case FromBoard.ADC_READ if frame.port < 2:
                counts = round(fraction(self._hardware.readings(now_ms)[frame.port]) * 0xFFFF)
                link.send([(ToBoard.ADC, frame.port, _ANSWER.pack(counts))], now_ms)
                return []
            case FromBoard.STATE if len(payload) == 1 and payload[0] in STATE_OF:
                old, self.state = self.state, STATE_OF[payload[0]]
                return [] if old is self.state else [StateReported(now_ms, old, self.state)]
            case FromBoard.LOG:
                return [Dropped(now_ms, payload.decode("utf-8", "replace"))] if frame.port == 1 else []
        raise FirmwareFailed(f"it sent a frame that cannot be: type {frame.kind}, port {frame.port}")

    def _pin(self, line: OutputPin, high: bool, now_ms: int) -> list[Action]:
        rises = high and not self._outputs[line]
        self._outputs[line] = high
        hardware = self._hardware
        match line:
            case OutputPin.CHARGE if isinstance(hardware, WorstCaseHardware):
                hardware.set_charger(high, now_ms)
            case OutputPin.WATCH_BATTERY if isinstance(hardware, WorstCaseHardware):
                hardware.watch_battery(high, now_ms)
            case OutputPin.MOTOR_UP if rises:
                return self._run_motors(Buoyancy.FLOAT, None, now_ms)
            case OutputPin.MOTOR_DOWN if rises:
                return self._run_motors(Buoyancy.SINK, None, now_ms)
        return []

    def _run_motors(self, to: Buoyancy, depth_mm: int | None, now_ms: int) -> list[Action]:
        return [self._hardware.run_motors(to, depth_mm, now_ms)]
