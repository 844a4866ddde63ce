"""What a V3 nanomodem prints, read as it must be: by counting, because the data of a message may hold any byte."""

from __future__ import annotations

import re
from dataclasses import dataclass

_LINE_BYTES = 120
"""Longer than any answer that is all text, help apart, which nobody asks for here."""
_QUALITY = re.compile(rb"Q\d\d(D[+-]\d{3})?")
_TIME = re.compile(rb"T\d{14}")
_MESSAGE = re.compile(rb"#(?:B(\d{3})|U)(\d\d)")


@dataclass(frozen=True, slots=True)
class Message:
    """Data from the water; a unicast does not say of whom."""

    source: int | None
    data: bytes


@dataclass(frozen=True, slots=True)
class Line:
    """Anything else, without its CR LF."""

    text: bytes


class AnswerReader:
    """Takes chunks as they come; bytes that are no answer are counted in `skipped_bytes`."""

    def __init__(self) -> None:
        self.skipped_bytes = 0
        self._bytes = bytearray()

    def forget(self) -> None:
        """What was begun will not go on."""
        self._bytes.clear()

    def take(self, data: bytes) -> list[Message | Line]:
        self._bytes += data
        came: list[Message | Line] = []
        while (found := self._next()) is not None:
            came.append(found)
        return came

    def _next(self) -> Message | Line | None:
        self._skip_noise()
        taken = bytes(self._bytes)
        if taken[:2] in (b"#B", b"#U"):
            head = _MESSAGE.match(taken)
            if head is not None:
                return self._message(taken, head)
            if len(taken) < (7 if taken[1:2] == b"B" else 4):
                return None
        end = taken.find(b"\r\n")
        if end < 0:
            return None
        del self._bytes[: end + 2]
        return Line(taken[:end])

    def _message(self, taken: bytes, head: re.Match[bytes]) -> Message | None:
        """The message once its end is there: its data may be followed by its quality and a time."""
        size = int(head[2])
        rest = taken[head.end() + size :]
        at = 0
        for appended in (_QUALITY, _TIME):
            if (found := appended.match(rest, at)) is not None:
                at = found.end()
        if rest[at : at + 2] == b"\r\n":
            del self._bytes[: head.end() + size + at + 2]
            return Message(None if head[1] is None else int(head[1]), taken[head.end() : head.end() + size])
        # Enough bytes are there for the longest message, but not its end: they are no message.
        if len(rest) >= 8 + 15 + 2:
            self._drop(1)
            return self._next_message()
        return None

    def _next_message(self) -> Message | None:
        found = self._next()
        return found if isinstance(found, Message) else None

    def _skip_noise(self) -> None:
        """Answers begin with `#`, `$` or `E`."""
        starts = [at for at in (self._bytes.find(first) for first in (b"#", b"$", b"E")) if at >= 0]
        self._drop(min(starts, default=len(self._bytes)))
        if len(self._bytes) > _LINE_BYTES and b"\r\n" not in self._bytes[:_LINE_BYTES]:
            self._drop(1)

    def _drop(self, count: int) -> None:
        self.skipped_bytes += count
        del self._bytes[:count]
