"""A serial line of 9600 baud, 8N1, both ways. A byte takes 10 bits, 25/24 ms, so time is counted in 24ths of a ms."""

from __future__ import annotations

from collections import deque

from agents.modem.commands import CommandReader, Malformed, ModemCommand
from agents.modem.frames import ModemGeneration

TICKS_PER_MS = 24
BYTE_TICKS = 25
SILENCE_TICKS = 2 * TICKS_PER_MS
"""The manual's 2 ms: the next byte must begin within this time of a byte's end."""
BUFFER_BYTES = 4096
"""The line loses bytes beyond these, if they are written faster than the modem can read them."""


class SerialLine:
    """Bytes with their times. The bytes of a chunk follow each other at once, after the bytes still on the line."""

    def __init__(self, generation: ModemGeneration) -> None:
        self.reader = CommandReader(generation)
        self._coming: deque[tuple[int, int]] = deque()
        """(the tick of the byte's end, the byte)"""
        self._last_tick = 0
        self._free_tick = 0
        self._going: deque[tuple[int, bytes]] = deque()
        self._out_free_tick = 0

    def write(self, data: bytes, now_ms: int, paused: bool = False) -> int:
        """Sends bytes to the modem from `now_ms` on, after a silence if `paused`. Returns how many of them are lost."""
        room = BUFFER_BYTES - len(self._coming)
        tick = max(now_ms * TICKS_PER_MS, self._free_tick + paused * (SILENCE_TICKS + 1))
        for byte in data[:room]:
            tick += BYTE_TICKS
            self._coming.append((tick, byte))
        self._free_tick = tick
        return max(0, len(data) - room)

    def empty(self) -> None:
        """Loses the bytes under way in both directions, because the power went."""
        self._coming.clear()
        self._going.clear()

    def reset(self) -> None:
        """Discards a command that was begun, because the modem restarts."""
        self.reader.fell_silent()
        self.reader.timed = False

    @property
    def input_due_ms(self) -> int | None:
        """The time at which the next byte ends, or the silence within a command becomes too long."""
        if self._coming and (not self.reader.waiting or not self._silence_before_next()):
            return _ms(self._coming[0][0])
        return (self._last_tick + SILENCE_TICKS) // TICKS_PER_MS + 1 if self.reader.waiting else None

    @property
    def wake_ms(self) -> int | None:
        """Like `input_due_ms`, but later where the bytes before then certainly complete nothing."""
        due_ms, coming, last = self.input_due_ms, self._coming, min(self.reader.least, len(self._coming)) - 1
        if last <= 0 or self._silence_before_next() or coming[last][0] - coming[0][0] != last * BYTE_TICKS:
            return due_ms
        return max(_ms(coming[last][0]), due_ms or 0)

    def _silence_before_next(self) -> bool:
        return self._coming[0][0] - BYTE_TICKS > self._last_tick + SILENCE_TICKS

    def read(self, now_ms: int) -> tuple[int, list[ModemCommand | Malformed]] | None:
        """Reads bytes until one completes an item: (tick, items); None if nothing more is due by `now_ms`."""
        reader = self.reader
        while (due_ms := self.input_due_ms) is not None and due_ms <= now_ms:
            if not self._coming or (reader.waiting and self._silence_before_next()):
                if (silent := reader.fell_silent()) is not None:
                    return due_ms * TICKS_PER_MS, [silent]
                continue
            tick, byte = self._coming.popleft()
            self._last_tick = tick
            if items := reader.take(byte):
                return tick, items
        return None

    def answer(self, data: bytes, tick: int) -> None:
        """Prints bytes from `tick` on, after earlier answers."""
        self._out_free_tick = max(self._out_free_tick, tick) + len(data) * BYTE_TICKS
        self._going.append((self._out_free_tick, data))

    @property
    def output_due_ms(self) -> int | None:
        return _ms(self._going[0][0]) if self._going else None

    def printed(self) -> bytes:
        """The next answer that has left; IndexError if there is none."""
        return self._going.popleft()[1]


def _ms(tick: int) -> int:
    return -(-tick // TICKS_PER_MS)
