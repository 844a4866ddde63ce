"""A serial port that may disappear: it is read and written without blocking, and a lost port is reopened with back-off."""

from __future__ import annotations

import select
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import serial

NANOMODEM_BAUD = 9600
_FIRST_RETRY_S = 0.25
_LAST_RETRY_S = 8.0


@dataclass(frozen=True, slots=True)
class Opened:
    pass


@dataclass(frozen=True, slots=True)
class Lost:
    why: str


@dataclass(frozen=True, slots=True)
class BytesRead:
    data: bytes


PortEvent = Opened | Lost | BytesRead


class SerialPort:
    """A port owned by one thread, which calls `poll` at any rate. `clock` gives wall seconds, for the back-off alone."""

    def __init__(
        self, path: str, clock: Callable[[], float] = time.monotonic, baud: int = NANOMODEM_BAUD
    ) -> None:
        self.path = path
        self._baud = baud
        self.why_closed = "it has not been opened yet"
        self._clock = clock
        self._port: Any = None
        self._retry_s = _FIRST_RETRY_S
        self._next_try_s = clock()
        self._events: list[PortEvent] = []

    @property
    def is_open(self) -> bool:
        return self._port is not None

    def poll(self) -> list[PortEvent]:
        """The events since the last call; opens the port if it is time to."""
        if self._port is None and self._clock() >= self._next_try_s:
            self._open()
        if self._port is not None:
            try:
                if data := self._port.read(4096):
                    self._events.append(BytesRead(data))
            except (
                OSError,
                TypeError,
            ) as error:  # pyserial raises TypeError for a port that disappears in a read
                self._lose(str(error))
        events, self._events = self._events, []
        return events

    def wait(self, timeout_s: float) -> None:
        """Waits until there are bytes, the port is lost, or it is time to open it; `timeout_s` at most."""
        poll = select.poll()
        if self._port is None:
            timeout_s = min(timeout_s, max(0.0, self._next_try_s - self._clock()))
        else:
            poll.register(self._port.fileno(), select.POLLIN)
        poll.poll(1000 * timeout_s)

    def write(self, data: bytes) -> None:
        """Writes bytes; they are lost if the port is closed, or lost now. `poll` then returns Lost, once."""
        if self._port is None:
            return
        try:
            self._port.write(data)
        except OSError as error:
            self._lose(str(error))

    def close(self) -> None:
        if self._port is not None:
            self._port.close()
            self._port = None

    def _open(self) -> None:
        try:
            # Exclusive: two programs that command one modem would read each other's answers.
            self._port = serial.Serial(self.path, self._baud, timeout=0, write_timeout=1.0, exclusive=True)
        except (OSError, ValueError) as error:
            self.why_closed = str(error)
            self._schedule_retry()
            return
        self._retry_s = _FIRST_RETRY_S
        self._events.append(Opened())

    def _lose(self, why: str) -> None:
        self.why_closed = why
        self.close()
        self._events.append(Lost(why))
        self._schedule_retry()

    def _schedule_retry(self) -> None:
        self._next_try_s = self._clock() + self._retry_s
        self._retry_s = min(2 * self._retry_s, _LAST_RETRY_S)
