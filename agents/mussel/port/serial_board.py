"""A real board on a serial line, which loses and changes bytes: a turn is sent again until its answer is whole.

A frame that was damaged is left out at either end. The bench repeats the turn, and the board its answer, until each frame
has come; a frame that came before is left out too. A board that has begun anew says so (docs/firmware-port.md).
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Sequence

from agents.mussel.firmware_failure import FirmwareFailed
from agents.mussel.port.board_link import TURN_TIMEOUT_S, FrameToBoard
from agents.serial_port import BytesRead, Lost, Opened, SerialPort
from firmware_model.port_frames import (
    OUT_OF_COUNT,
    VERSION,
    Frame,
    FrameReader,
    FromBoard,
    ToBoard,
    counter_at,
)

REPEAT_S = 0.25
"""The wall time without a frame after which the turn is sent again."""
_AFTER_DAMAGE_S = 0.02
_HALF = 1 << 31
_RESTART = Frame(ToBoard.HELLO, 0, 0, OUT_OF_COUNT, VERSION.to_bytes(2, "little")).encode()


class SerialBoard:
    """A `BoardLink` over a serial line, which may be pulled out and put back within a turn's time."""

    pid: int | None = None

    def __init__(
        self,
        device: str,
        baud: int,
        timeout_s: float = TURN_TIMEOUT_S,
        repeat_s: float = REPEAT_S,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """`clock` gives wall seconds, for the time that a turn may take and for the repeats."""
        self._port = SerialPort(device, clock, baud)
        self._timeout_s, self._repeat_s, self._clock = timeout_s, repeat_s, clock
        self._reader = FrameReader()
        self._sent = self._received = 0
        self._has_begun = False
        """The board has left its reset: it is in this exchange from its first frame on."""
        self._turn = b""
        """All frames of this turn so far, for a repeat."""
        self._deadline_s = self._repeat_at_s = clock()
        self.repeats = 0

    @property
    def damaged(self) -> int:
        """The pieces that came and were no frame."""
        return self._reader.damaged

    def close(self) -> None:
        self._port.close()

    def send(self, frames: Sequence[FrameToBoard], now_ms: int) -> None:
        now_s = self._clock()
        if frames[0][0] in (ToBoard.HELLO, ToBoard.RUN):
            self._turn = b""
            self._deadline_s = now_s + self._timeout_s
        data = b""
        for kind, port, payload in frames:
            data += Frame(kind, port, counter_at(now_ms), self._sent, payload).encode()
            self._sent = self._sent + 1 & 0xFFFF_FFFF
        self._turn += data
        self._repeat_at_s = now_s + self._repeat_s
        if self._has_begun:
            self._port.write(data)

    def receive(self) -> list[Frame]:
        while True:
            if frames := self._poll():
                return frames
            now_s = self._clock()
            if now_s >= self._deadline_s:
                raise FirmwareFailed(self._silence(), hung=True)
            if now_s >= self._repeat_at_s:
                self._repeat()
            self._port.wait(max(0.0, min(self._deadline_s, self._repeat_at_s) - self._clock()))

    def _poll(self) -> list[Frame]:
        frames: list[Frame] = []
        for event in self._port.poll():
            match event:
                case BytesRead(data):
                    frames += self._taken(data)
                case Lost(why):
                    print(f"{self._port.path} was lost: {why}", file=sys.stderr, flush=True)
                case Opened():
                    self._repeat()
        return frames

    def _taken(self, data: bytes) -> list[Frame]:
        """The frames that are due. One that came before, or after a gap, waits for the repeat."""
        frames = []
        damaged = self.damaged
        for frame in self._reader.feed_noisy(data):
            if frame.sequence == OUT_OF_COUNT and frame.kind == FromBoard.HELLO:
                self._has_left_reset()
            elif frame.sequence == self._received and self._has_begun:
                self._received = self._received + 1 & 0xFFFF_FFFF
                frames.append(frame)
            elif (frame.sequence - self._received) & 0xFFFF_FFFF < _HALF:
                damaged = -1
        now_s = self._clock()
        if frames:
            self._repeat_at_s = now_s + self._repeat_s
        if damaged != self.damaged:
            self._repeat_at_s = min(self._repeat_at_s, now_s + _AFTER_DAMAGE_S)
        return frames

    def _has_left_reset(self) -> None:
        # Before its first frame it may have told so twice: by itself, and because it was asked.
        if self._received:
            raise FirmwareFailed("it was reset, and not by the bench")
        self._has_begun = True
        self._repeat()

    def _repeat(self) -> None:
        """Sends the turn again; before the board has begun, the order to do so."""
        self._port.write(self._turn if self._has_begun else _RESTART)
        self._repeat_at_s = self._clock() + self._repeat_s
        self.repeats += 1

    def _silence(self) -> str:
        if not self._port.is_open:
            return f"{self._port.path} was not there for {self._timeout_s:g} s: {self._port.why_closed}"
        if not self._has_begun:
            return f"no board answered on {self._port.path} within {self._timeout_s:g} s"
        return f"it did not end its turn within {self._timeout_s:g} s"
