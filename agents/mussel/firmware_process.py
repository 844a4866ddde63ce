"""Somebody's firmware in a process of its own: it decides on a board whose hardware stays here.

The process is a child of this one and ends with it. One turn is a write of what happened and of RUN, and a read up to the
board's SLEEP; the rules are those of docs/firmware-port.md. The process starts with the first turn, and not with the board:
a nursery makes boards before it forks the agents that they belong to.
"""

from __future__ import annotations

import ctypes
import os
import signal
import socket
import struct
import weakref
from collections.abc import Sequence

from agents.hosting.link_protocol import readable
from agents.mussel.firmware_failure import FirmwareFailed
from firmware_model.actions import Action, Buoyancy, Dropped, SendBytes, StateReported
from firmware_model.config import BoardConfig
from firmware_model.hardware.worst_case import WorstCaseHardware
from firmware_model.port import Level, Timer
from firmware_model.port_frames import (
    MOST_FRAMES,
    VERSION,
    BadFrame,
    Frame,
    FrameReader,
    FromBoard,
    InputPin,
    OutputPin,
    ToBoard,
    Uart,
    alarm_ms,
    counter_at,
)
from firmware_model.power.charge import fraction
from firmware_model.power.rails import Rail
from firmware_model.states import State
from firmware_model.stimuli import ResetCause

PORT_VARIABLE = "MUSSELBED_PORT"
"""The environment variable with the number of the board's descriptor."""
TURN_TIMEOUT_S = 8.0
"""The wall time that a turn may take. It is shorter than the patience of the fleet's watchdog with an agent."""
_ENDING_S = 1.0
"""The wall time in which a process whose link has ended is expected to end."""
_PORT_FD = 3
_NO_PROGRAM = 127
"""The exit status of a child that could not become the program, as a shell's."""
_HELLO = struct.Struct("<HHIIIIII")
_ANSWER = struct.Struct("<H")
_COUNTER = struct.Struct("<I")
_PR_SET_PDEATHSIG = 1
_LIBC = ctypes.CDLL(None)
_STATES = {int(state): state for state in State}
_RAIL_OF = {Uart.MODEM: Rail.MODEM_TRANSMITTING, Uart.WIFI: Rail.WIFI}
_AT_ONCE = 65_536


class FirmwareProcess:
    """A `firmware_model.port.FirmwareLike` in another process, on the hardware of the paper's worst case."""

    clock_offset_ms = 0

    def __init__(
        self,
        command: Sequence[str],
        config: BoardConfig,
        hardware: WorstCaseHardware,
        seed: int,
        timeout_s: float = TURN_TIMEOUT_S,
    ) -> None:
        """`command` is an executable and its arguments. `seed` is the run's."""
        self.state = State.OFF
        self.reset_cause: ResetCause | None = None
        self._command = tuple(command)
        self._config = config
        self._hardware = hardware
        self._seed = seed
        self._timeout_s = timeout_s
        self._reader = FrameReader()
        self._sent = self._received = 0
        self._alarm_ms: int | None = None
        self._child: _Child | None = None
        self._outputs = dict.fromkeys(OutputPin, 0)

    @property
    def pid(self) -> int | None:
        """The process; None before the first turn."""
        return None if self._child is None else self._child.pid

    def close(self) -> None:
        """Ends the process."""
        if self._child is not None:
            self._child.end()

    def start(self, cause: ResetCause, now_ms: int) -> list[Action]:
        """The MCU left reset; the process begins with the first timer, which is due at once."""
        self.reset_cause = cause
        self.state = State.BOOTING
        self._alarm_ms = now_ms
        return []

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

    def _turn(self, now_ms: int, *interrupts: tuple[ToBoard, int, bytes]) -> list[Action]:
        """Tells the board what happened, lets it run, and takes what it does until it sleeps, or FirmwareFailed."""
        frames = list(interrupts)
        head: list[tuple[ToBoard, int, bytes]] = []
        if self._child is None:
            head = [self._boot()]
            assert self.reset_cause is not None
            frames.insert(0, (ToBoard.RESET, 0, bytes([self.reset_cause])))
        frames = [*head, (ToBoard.RUN, 0, bytes([self._levels(), len(frames)])), *frames]
        self._send(frames, now_ms)
        self._alarm_ms = None
        actions: list[Action] = []
        count = 0
        while True:
            for frame in self._receive():
                count += 1
                if count > MOST_FRAMES:
                    raise FirmwareFailed(f"{MOST_FRAMES} frames in one turn")
                if frame.kind == FromBoard.SLEEP:
                    self._sleep(frame, now_ms)
                    return actions
                actions += self._take(frame, now_ms)

    def _boot(self) -> tuple[ToBoard, int, bytes]:
        self._child = child = _Child(self._command, self._timeout_s)
        weakref.finalize(self, child.end)
        config = self._config
        hello = _HELLO.pack(
            VERSION,
            config.agent_id,
            self._seed & 0xFFFFFFFF,
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

    def _send(self, frames: Sequence[tuple[ToBoard, int, bytes]], now_ms: int) -> None:
        data = b""
        for kind, port, payload in frames:
            data += Frame(kind, port, counter_at(now_ms), self._sent, payload).encode()
            self._sent = self._sent + 1 & 0xFFFFFFFF
        assert self._child is not None
        try:
            self._child.link.sendall(data)
        except TimeoutError:
            raise FirmwareFailed(f"it read nothing for {self._timeout_s:g} s", hung=True) from None
        except OSError:
            raise FirmwareFailed(self._ending()) from None

    def _receive(self) -> list[Frame]:
        assert self._child is not None
        try:
            data = self._child.link.recv(_AT_ONCE)
        except TimeoutError:
            raise FirmwareFailed(f"it did not end its turn within {self._timeout_s:g} s", hung=True) from None
        except OSError:
            data = b""
        if not data:
            raise FirmwareFailed(self._ending())
        try:
            frames = list(self._reader.feed(data))
        except BadFrame as error:
            raise FirmwareFailed(f"it sent {error}") from None
        for frame in frames:
            if frame.sequence != self._received:
                raise FirmwareFailed(f"frame {frame.sequence} came where {self._received} was due")
            self._received = self._received + 1 & 0xFFFFFFFF
        return frames

    def _ending(self) -> str:
        status = None if self._child is None else self._child.end(_ENDING_S)
        if status is not None and os.WIFSIGNALED(status):
            return f"it was killed by {signal.Signals(os.WTERMSIG(status)).name}"
        return (
            "it ended" if status is None else f"it ended with exit status {os.waitstatus_to_exitcode(status)}"
        )

    def _sleep(self, frame: Frame, now_ms: int) -> None:
        if frame.port == 1:
            if len(frame.payload) != _COUNTER.size:
                raise FirmwareFailed("it sent a SLEEP of another length")
            self._alarm_ms = alarm_ms(_COUNTER.unpack(frame.payload)[0], now_ms)

    def _take(self, frame: Frame, now_ms: int) -> list[Action]:
        """Carries out one frame of the board."""
        payload = frame.payload
        match frame.kind:
            case FromBoard.HELLO if len(payload) >= _ANSWER.size:
                version = _ANSWER.unpack_from(payload)[0]
                if version != VERSION:
                    raise FirmwareFailed(f"it speaks version {version} of the port, and not {VERSION}")
                return []
            case FromBoard.PIN if frame.port in self._outputs and len(payload) == 1:
                return self._pin(OutputPin(frame.port), payload[0] != 0, now_ms)
            case FromBoard.UART_TX if frame.port in _RAIL_OF:
                return [SendBytes(now_ms, _RAIL_OF[Uart(frame.port)], payload)]
            case FromBoard.ADC_READ if frame.port < 2:
                counts = round(fraction(self._hardware.readings(now_ms)[frame.port]) * 0xFFFF)
                self._send([(ToBoard.ADC, frame.port, _ANSWER.pack(counts))], now_ms)
                return []
            case FromBoard.STATE if len(payload) == 1 and payload[0] in _STATES:
                old, self.state = self.state, _STATES[payload[0]]
                return [] if old is self.state else [StateReported(now_ms, old, self.state)]
            case FromBoard.LOG:
                text = payload.decode("utf-8", "replace")
                return [Dropped(now_ms, text)] if frame.port == 1 else []
        raise FirmwareFailed(f"it sent a frame that cannot be: type {frame.kind}, port {frame.port}")

    def _pin(self, line: OutputPin, high: bool, now_ms: int) -> list[Action]:
        rises = high and not self._outputs[line]
        self._outputs[line] = high
        match line:
            case OutputPin.CHARGE:
                self._hardware.set_charger(high, now_ms)
            case OutputPin.WATCH_BATTERY:
                self._hardware.watch_battery(high, now_ms)
            case OutputPin.MOTOR_UP if rises:
                return [self._hardware.run_motors(Buoyancy.FLOAT, None, now_ms)]
            case OutputPin.MOTOR_DOWN if rises:
                return [self._hardware.run_motors(Buoyancy.SINK, None, now_ms)]
        return []


class _Child:
    """The process and this end of its link. FirmwareFailed if there can be none."""

    def __init__(self, command: Sequence[str], timeout_s: float) -> None:
        self.link, theirs = socket.socketpair()
        self.link.settimeout(timeout_s)
        parent = os.getpid()
        with theirs:
            try:
                self.pid = os.fork()
            except OSError as error:
                self.link.close()
                raise FirmwareFailed(f"no process: {error.strerror}") from None
            if self.pid == 0:
                _become(command, theirs.fileno(), parent)
        self._owner = parent
        self._is_over = False

    def end(self, patience_s: float = 0.0) -> int | None:
        """Ends the process, after so long for it to end by itself: its wait status, or None if it has ended before."""
        if self._is_over or os.getpid() != self._owner:
            return None
        self._is_over = True
        self.link.close()
        descriptor = os.pidfd_open(self.pid)
        try:
            if not readable(descriptor, patience_s):
                os.kill(self.pid, signal.SIGKILL)
            return os.waitpid(self.pid, 0)[1]
        finally:
            os.close(descriptor)


def _become(command: Sequence[str], fd: int, parent: int) -> None:
    """The child's steps up to its program; it never returns."""
    try:
        _LIBC.prctl(_PR_SET_PDEATHSIG, signal.SIGKILL, 0, 0, 0)
        if os.getppid() != parent:
            os._exit(0)
        signal.set_wakeup_fd(-1)
        for number in (signal.SIGPIPE, signal.SIGINT, signal.SIGTERM, signal.SIGCHLD):
            signal.signal(number, signal.SIG_DFL)
        null = os.open(os.devnull, os.O_RDWR)
        os.dup2(null, 0)
        os.dup2(null, 1)
        os.dup2(fd, _PORT_FD)
        os.set_inheritable(_PORT_FD, True)
        os.closerange(_PORT_FD + 1, os.sysconf("SC_OPEN_MAX"))
        os.execve(command[0], list(command), {**os.environ, PORT_VARIABLE: str(_PORT_FD)})
    finally:
        os._exit(_NO_PROGRAM)
