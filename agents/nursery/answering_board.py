"""A board in the nursery's own process, with every frame that a board may send in each turn.

The nursery plays it before it forks, so that agents share the code that speaks to firmware in a process of its own.
"""

from __future__ import annotations

import struct
from socket import socketpair

from agents.hosting.link_protocol import readable
from firmware_model.port_frames import (
    VERSION,
    Frame,
    FrameReader,
    FromBoard,
    OutputPin,
    ToBoard,
    Uart,
    counter_at,
)
from firmware_model.states import State

_ALARM_MS = 700
_STATES = (State.ACTIVE, State.FLOATING)


class AnsweringBoard:
    """An `agents.mussel.port.firmware_process.Program` that answers as soon as the bench writes."""

    pid = 0

    def __init__(self) -> None:
        self._ours, self._bench = socketpair()
        self._reader = FrameReader()
        self._sent = self._turns = 0

    @property
    def link(self) -> AnsweringBoard:
        return self

    def fileno(self) -> int:
        return self._bench.fileno()

    has_ended = False

    def awaits(self, timeout_s: float, *, writes: bool) -> bool:
        return readable(self.fileno(), timeout_s)

    def end(self, patience_s: float = 0.0) -> int | None:
        self._ours.close()
        self._bench.close()
        return None

    def send(self, data: bytes, flags: int, /) -> int:
        """Takes the bench's frames of a turn, and answers RUN with a whole turn, and an ADC's counts with its end."""
        for frame in self._reader.feed(data):
            if frame.kind == ToBoard.HELLO:
                self._send(FromBoard.HELLO, 0, struct.pack("<H", VERSION))
            elif frame.kind == ToBoard.RUN:
                self._turns += 1
                self._send(FromBoard.STATE, 0, bytes([_STATES[self._turns % 2]]))
                for line in OutputPin:
                    self._send(FromBoard.PIN, line, b"\1")
                    self._send(FromBoard.PIN, line, b"\0")
                self._send(FromBoard.LOG, 1, b"refused")
                self._send(FromBoard.UART_TX, Uart.MODEM, b"sent")
                self._send(FromBoard.ADC_READ, 0)
            elif frame.kind == ToBoard.ADC:
                alarm = (frame.counter + counter_at(_ALARM_MS)) & 0xFFFF_FFFF
                self._send(FromBoard.SLEEP, 1, struct.pack("<I", alarm))
        return len(data)

    def _send(self, kind: FromBoard, port: int, payload: bytes = b"") -> None:
        self._ours.sendall(Frame(kind, port, 0, self._sent, payload).encode())
        self._sent += 1
