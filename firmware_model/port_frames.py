"""The port of a board as bytes, for firmware in a process of its own: frames, their framing, and the board's counter.

A frame is a little-endian head (type, port, length of the payload, the board's counter, sequence), the payload, and a
CRC-16/CCITT of both. On the stream it is encoded by COBS and ends with a zero byte, so that a reader finds the next frame
after any noise. docs/firmware-port.md has the rules of the exchange.
"""

from __future__ import annotations

import re
import struct
from binascii import crc_hqx
from collections.abc import Iterator
from dataclasses import dataclass
from enum import IntEnum

VERSION = 1
COUNTER_HZ = 32_768
MAX_PAYLOAD = 1024
OUT_OF_COUNT = 0xFFFF_FFFF
"""The sequence of a HELLO on a serial line that is no part of the exchange: from the bench it restarts the board, and from
the board it tells that the board has begun anew."""
MOST_FRAMES = 10_000
"""A board that sends so many frames at one time of its counter, in one turn or in many, does not come to an end."""
_HEAD = struct.Struct("<BBHII")
_CRC = struct.Struct("<H")
_BLOCK = re.compile(rb"([^\0]{254})|([^\0]{1,253})\0|\0+")
"""A block of COBS: as many bytes as a code can count, or fewer that a zero ends; or a row of blocks without bytes."""
_CODES = [bytes([size + 1]) for size in range(255)]
_MAX_ENCODED = (_HEAD.size + MAX_PAYLOAD + _CRC.size) * 255 // 254 + 2
_COUNTER_MASK = (1 << 32) - 1
_HALF = 1 << 31


class ToBoard(IntEnum):
    """Types of frames from the bench to the board."""

    HELLO = 1
    """Version u16, id u16, seed u32; debounce, boot, surfacing, float and release times in ms, u32 each. Behind
    that a whole board's has the numbers of its firmware."""
    RESET = 2
    """Cause u8: the program begins. Output pins are low."""
    RUN = 3
    """The levels of the input pins as bits, u8; how many interrupts follow, u8: the board's turn, until it sleeps."""
    PIN = 4
    """`port` is the line; level u8. An interrupt: the line changed, or repeats its level."""
    UART_RX = 5
    """`port` is the UART; bytes."""
    ADC = 6
    """`port` is the channel; counts u16: the answer to ADC_READ."""
    I2C = 7
    """`port` is an `I2cResult`; the bytes that were read: the answer to I2C."""
    FLASH = 8
    """`port` is 0, or 1 for an error; the bytes that were read: the answer to the three calls of the flash."""


class FromBoard(IntEnum):
    """Types of frames from the board to the bench."""

    HELLO = 65
    """Version u16, then a name in UTF-8."""
    SLEEP = 66
    """Bit 0 of `port` is 1 with an alarm: counter u32. The other bits are a whole board's `SleepMode`. Ends the turn."""
    PIN = 67
    """`port` is the line; level u8."""
    UART_TX = 68
    """`port` is the UART; bytes."""
    ADC_READ = 69
    """`port` is the channel."""
    STATE = 70
    """A state of docs/firmware-states.md, u8, for records and reports. No energy follows from it."""
    LOG = 71
    """`port` is 1 for an input that the firmware refused, 0 for other text; UTF-8."""
    I2C = 72
    """`port` is the address; the number of bytes to read, u8; the bytes to write. A whole board's, as all that follow."""
    FLASH_READ = 73
    """Address u32, size u16."""
    FLASH_PROGRAM = 74
    """Address u32, bytes."""
    FLASH_ERASE = 75
    """Page u16."""
    BUSY = 76
    """ms u32: the core of a sleeping board stays awake for so long."""
    KICK = 77
    """ms u32: unless it comes again within this time, the watchdog resets the board; 0 stops the watchdog."""


class InputPin(IntEnum):
    CHARGER = 0
    """High while a dock's charger has contact; not debounced."""
    SURFACE = 1
    """High while the pressure sensor reads the surface."""
    BOTTOM = 2
    """The pressure sensor stopped rising: the aMussel rests on the bottom."""
    BATTERY_EMPTY = 3
    """The battery monitor's interrupt: in the worst case while WATCH_BATTERY is high. On a whole board the feeding battery
    is empty, and the switch has moved."""
    CLOCK = 4
    """The clock chip's alarm; this and all that follow are a whole board's."""
    SAFE_LEVEL = 5
    """The backup battery feeds the board, and came to its safe level."""
    ON_SECONDARY = 6
    """High while the backup battery feeds the board; it does not interrupt."""
    LOW_LEVEL = 8
    """The primary came to its low level. This and those below have no level in RUN."""
    SWITCH_BACK = 9
    """The primary feeds the board again."""
    REPORT = 10
    """The experiment asks for a full status at UART 2."""


class OutputPin(IntEnum):
    CHARGE = 0
    """High lets the charger feed the battery, for as long as it has contact. A reset leaves it."""
    MOTOR_UP = 1
    """A rising edge runs the buoyancy motors up."""
    MOTOR_DOWN = 2
    WATCH_BATTERY = 3
    """High arms the battery monitor's interrupt."""


class Uart(IntEnum):
    MODEM = 0
    WIFI = 1
    REPORT = 2
    """The experiment's own line, for the answer to the interrupt REPORT."""


class SleepMode(IntEnum):
    """The core between two turns."""

    AWAKE = 0
    DEEP = 1


class I2cResult(IntEnum):
    DONE = 0
    NO_ANSWER = 1
    """No device answers at this address, or it has no power, or it takes no such bytes (a NACK)."""


class BadFrame(ValueError):
    """Bytes that are no frame."""


@dataclass(frozen=True, slots=True)
class Frame:
    kind: int
    port: int
    counter: int
    sequence: int
    payload: bytes = b""

    def encode(self) -> bytes:
        """The frame on the stream, with its closing zero."""
        body = _HEAD.pack(self.kind, self.port, len(self.payload), self.counter, self.sequence) + self.payload
        return _stuffed(body + _CRC.pack(crc_hqx(body, 0xFFFF))) + b"\0"

    @classmethod
    def decode(cls, encoded: bytes) -> Frame:
        """The frame of the bytes between two zeros; BadFrame for others."""
        data = _unstuffed(encoded)
        body = data[: -_CRC.size]
        if len(body) < _HEAD.size or crc_hqx(body, 0xFFFF) != _CRC.unpack(data[-_CRC.size :])[0]:
            raise BadFrame("a frame whose check is wrong")
        kind, port, length, counter, sequence = _HEAD.unpack_from(body)
        if length != len(body) - _HEAD.size or length > MAX_PAYLOAD:
            raise BadFrame("a frame of another length than it states")
        return cls(kind, port, counter, sequence, body[_HEAD.size :])


class FrameReader:
    """Cuts a stream into frames. Empty frames (two zeros in a row) are skipped."""

    def __init__(self) -> None:
        self._rest = b""
        self._empty = 0
        """Empty frames since the last one."""
        self.damaged = 0
        """The pieces of a noisy stream that were no frame."""

    def feed(self, data: bytes) -> Iterator[Frame]:
        """The frames that end in `data`, in order.

        BadFrame for one that is none, for a frame without an end, and for `MOST_FRAMES` empty ones in a row.
        """
        *whole, self._rest = (self._rest + data).split(b"\0")
        for encoded in whole:
            self._empty = 0 if encoded else self._empty + 1
            if encoded:
                yield Frame.decode(encoded)
            elif self._empty >= MOST_FRAMES:
                raise BadFrame("zeros without an end")
        if len(self._rest) > _MAX_ENCODED:
            raise BadFrame("a frame without an end")

    def feed_noisy(self, data: bytes) -> Iterator[Frame]:
        """The frames that end in `data`, in order. Anything else is left out and counted."""
        *whole, self._rest = (self._rest + data).split(b"\0")
        for encoded in filter(None, whole):
            try:
                yield Frame.decode(encoded)
            except BadFrame:
                self.damaged += 1
        if len(self._rest) > _MAX_ENCODED:
            self._rest = b""
            self.damaged += 1


def _stuffed(data: bytes) -> bytes:
    """COBS: each block behind its code, as if a zero ended the data."""
    return _BLOCK.sub(_coded, data + b"\0")


def _coded(block: re.Match[bytes]) -> bytes:
    if block.lastindex is None:
        return b"\1" * len(block[0])
    content = block[block.lastindex]
    return _CODES[len(content)] + content


def _unstuffed(encoded: bytes) -> bytes:
    out = bytearray()
    at, size = 0, len(encoded)
    while at < size:
        code = encoded[at]
        if code == 0 or at + code > size:
            raise BadFrame("bytes that are no COBS")
        out += encoded[at + 1 : at + code]
        at += code
        if code < 255 and at < size:
            out.append(0)
    return bytes(out)


def counter_at(now_ms: int) -> int:
    """The board's counter at agent time `now_ms`: it begins at 0 and wraps after 36 hours."""
    return now_ms * COUNTER_HZ // 1000 & _COUNTER_MASK


def alarm_ms(counter: int, now_ms: int) -> int:
    """The first millisecond from `now_ms` on at which the counter has reached `counter`; `now_ms` for one that has passed.

    A counter less than 2^31 ahead is in the future, any other in the past.
    """
    ticks = now_ms * COUNTER_HZ // 1000
    ahead = (counter - ticks) & _COUNTER_MASK
    return now_ms if ahead >= _HALF else max(now_ms, -(-(ticks + ahead) * 1000 // COUNTER_HZ))
