"""The one queue before a physical nanomodem, which speaks for a whole fleet: three verbs, bytes and packets.

The modem is asked for one thing at a time: a broadcast with the aMussel's id in its payload. Nothing is addressed to one
modem, because a unicast to aMussel 24 would be heard by a modem with address 24 alone. Its own address is read and shown,
and never written; ranges are not asked for, and those that it prints are kept out of everything, because they are to where
the modem hangs.

    GONE -> ASKED_WHO -> FREE -> ASKED_TO_SEND -> SENDING -> FREE        any -> GONE when the port is lost

What a V3 nanomodem prints, read as it must be: by counting, because the data of a message may hold any byte.

Three bytes before a packet that travels by a modem which is nobody's in particular: which way, and of whom it is.

One physical modem speaks for a whole fleet. It has one address of its own, and what it hears as a unicast names no sender:
so the aMussel's id travels in the payload, little-endian after a byte that says whether the aMussel speaks or is spoken to.
"""

from __future__ import annotations

import re
import struct
from collections import Counter
from dataclasses import dataclass
from enum import Enum, IntEnum

from agents.modem.frames import PAYLOAD_BYTES, Generation, duration_ms

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


_FORMAT = struct.Struct("<BH")
HEADER_BYTES = _FORMAT.size


class Way(IntEnum):
    FROM_AMUSSEL = 0xB1
    TO_AMUSSEL = 0xB2


_WAYS = {int(way): way for way in Way}


@dataclass(frozen=True, slots=True)
class Addressed:
    """A packet with whom it concerns; `agent_id` is up to 65535."""

    way: Way
    agent_id: int
    data: bytes

    def encode(self) -> bytes:
        return _FORMAT.pack(self.way, self.agent_id) + self.data


def decode(payload: bytes) -> Addressed | None:
    """What was heard; None for bytes without the header."""
    if len(payload) <= HEADER_BYTES:
        return None
    way, agent_id = _FORMAT.unpack_from(payload)
    known = _WAYS.get(way)
    return None if known is None else Addressed(known, agent_id, payload[HEADER_BYTES:])


ROOM = 64
"""Packets that wait, of all priorities: at half a second each, what is behind more than these is old when it is sent."""
WAIT_MS = 30_000
"""A packet that has waited for longer is not worth sending."""
ANSWER_MS = 1_000
"""A modem answers within some 80 ms; after this it has not."""
ATTEMPTS = 3
_TURNAROUND_MS = 20
_FEWEST, _MOST = PAYLOAD_BYTES[Generation.V3]
MOST_BYTES = _MOST - HEADER_BYTES


class Priority(IntEnum):
    """What goes first. Of one priority what was asked first goes first."""

    COMMAND = 0
    REPORT = 1


class Stage(Enum):
    GONE = "gone"
    ASKED_WHO = "asked who it is"
    FREE = "free"
    ASKED_TO_SEND = "asked to send"
    SENDING = "sending"


@dataclass(frozen=True, slots=True)
class Write:
    """Bytes for the serial port."""

    data: bytes


@dataclass(frozen=True, slots=True)
class Carried:
    """The packet has been sent whole: its last sound left at `at_ms`."""

    at_ms: int
    packet: Addressed


@dataclass(frozen=True, slots=True)
class Heard:
    """A packet came from the water."""

    at_ms: int
    packet: Addressed


@dataclass(frozen=True, slots=True)
class Dropped:
    """A packet, or something from the modem, came to nothing."""

    at_ms: int
    reason: str
    packet: Addressed | None = None


@dataclass(frozen=True, slots=True)
class Reported:
    """Something for a person: the modem came, was lost, or has an address."""

    at_ms: int
    what: str


Action = Write | Carried | Heard | Dropped | Reported


@dataclass(slots=True)
class _Waiting:
    priority: Priority
    number: int
    since_ms: int
    packet: Addressed
    attempts: int = 0


class ModemQueue:
    """Begins without a port. Times are mission milliseconds, which are real ones: sound cannot be accelerated."""

    def __init__(self, now_ms: int = 0) -> None:
        self.stage = Stage.GONE
        self.address: int | None = None
        """The modem's own, as it said."""
        self.dropped: Counter[str] = Counter()
        self._now_ms = now_ms
        self._reader = AnswerReader()
        self._waiting: list[_Waiting] = []
        self._sending: _Waiting | None = None
        self._until_ms: int | None = None
        """When the present stage has lasted too long, or, SENDING, when it is over."""
        self._number = 0

    @property
    def waiting(self) -> int:
        """How many packets wait, the one that is being sent not among them."""
        return len(self._waiting)

    @property
    def next_due_ms(self) -> int | None:
        dues = [it.since_ms + WAIT_MS for it in self._waiting]
        if self._until_ms is not None:
            dues.append(self._until_ms)
        return max(self._now_ms, min(dues)) if dues else None

    def advance(self, now_ms: int) -> list[Action]:
        """Lets time pass to `now_ms`, in order (ValueError if it went back)."""
        if now_ms < self._now_ms:
            raise ValueError(f"time went back: {now_ms} before {self._now_ms}")
        actions: list[Action] = []
        while (due_ms := self.next_due_ms) is not None and due_ms <= now_ms:
            self._now_ms = due_ms
            if self._until_ms is not None and self._until_ms <= due_ms:
                actions += self._run_out()
            for late in [it for it in self._waiting if it.since_ms + WAIT_MS <= due_ms]:
                self._waiting.remove(late)
                actions.append(self._drop("sound: waited too long for the modem", late.packet))
        self._now_ms = now_ms
        return actions

    def ask(self, packet: Addressed, priority: Priority, now_ms: int) -> list[Action]:
        """Queues a packet. A report takes the place of an older one of the same aMussel that still waits."""
        actions = self.advance(now_ms)
        if not _FEWEST <= len(packet.encode()) <= _MOST:
            reason = f"sound: {len(packet.data)} bytes, and a modem carries {MOST_BYTES} besides the id"
            return [*actions, self._drop(reason, packet)]
        if priority is Priority.REPORT:
            for older in [it for it in self._waiting if _same(it, packet)]:
                self._waiting.remove(older)
                actions.append(self._drop("sound: overtaken by a newer report", older.packet))
        self._number += 1
        self._waiting.append(_Waiting(priority, self._number, now_ms, packet))
        self._waiting.sort(key=lambda it: (it.priority, it.number))
        if len(self._waiting) > ROOM:
            actions.append(self._drop("sound: the modem's queue is full", self._waiting.pop().packet))
        return actions + self._send_next()

    def port_came(self, now_ms: int) -> list[Action]:
        """The port is open, perhaps again: who is there?"""
        return self.advance(now_ms) + self._ask_who()

    def port_went(self, why: str, now_ms: int) -> list[Action]:
        """The port is gone. What was being sent is tried again when it is back; what waits goes on waiting."""
        actions = self.advance(now_ms)
        if self.stage is Stage.GONE:
            return actions
        self._enter(Stage.GONE)
        actions.append(Reported(now_ms, f"the modem is gone, and its port is tried again: {why}"))
        return actions + self._try_again()

    def read(self, data: bytes, now_ms: int) -> list[Action]:
        """Bytes that the modem has printed."""
        actions = self.advance(now_ms)
        for came in self._reader.take(data):
            actions += self._hear(came) if isinstance(came, Message) else self._answer(came)
        return actions

    def _hear(self, message: Message) -> list[Action]:
        packet = decode(message.data)
        if packet is None:
            return [self._drop("sound: without an aMussel's id", None)]
        return [Heard(self._now_ms, packet)]

    def _answer(self, line: Line) -> list[Action]:
        text = line.text
        if text.startswith(b"#A") and text[2:5].isdigit():
            self.address = int(text[2:5])
            if self.stage is not Stage.ASKED_WHO:
                return []
            self._enter(Stage.FREE)
            return [
                Reported(self._now_ms, f"the modem is there, with address {self.address}"),
                *self._send_next(),
            ]
        if text.startswith(b"$B") and self.stage is Stage.ASKED_TO_SEND and self._sending is not None:
            size = len(self._sending.packet.encode())
            if text == b"$B%02d" % size:
                self._enter(Stage.SENDING, duration_ms(Generation.V3, size) + _TURNAROUND_MS)
                return []
        if text == b"E" and self.stage is Stage.ASKED_TO_SEND:
            self._enter(Stage.FREE)
            return [*self._try_again(), *self._send_next()]
        if text == b"$W" and self.stage is Stage.ASKED_WHO:
            return []
        if text.startswith(b"#R") or text == b"#TO":
            return [self._drop("sound: a range to where the modem hangs", None)]
        return [self._drop("modem: an answer to nothing that was asked", None)]

    def _run_out(self) -> list[Action]:
        """The stage's time is over."""
        if self.stage is Stage.SENDING and self._sending is not None:
            done = Carried(self._now_ms - _TURNAROUND_MS, self._sending.packet)
            self._sending = None
            self._enter(Stage.FREE)
            return [done, *self._send_next()]
        # No answer: whoever was there may have been changed for another, or sleeps.
        return [*self._try_again(), *self._ask_who()]

    def _ask_who(self) -> list[Action]:
        """A modem that was put to sleep wakes by `$W`, repeated. What it began to print has had its time."""
        self._reader.forget()
        self._enter(Stage.ASKED_WHO, ANSWER_MS)
        return [Write(b"$W"), Write(b"$?")]

    def _send_next(self) -> list[Action]:
        if self.stage is not Stage.FREE or not self._waiting:
            return []
        self._sending = self._waiting.pop(0)
        self._sending.attempts += 1
        payload = self._sending.packet.encode()
        self._enter(Stage.ASKED_TO_SEND, ANSWER_MS)
        return [Write(b"$B%02d" % len(payload) + payload)]

    def _try_again(self) -> list[Action]:
        """What was being sent goes back to the head of its priority, or is given up."""
        failed, self._sending = self._sending, None
        if failed is None:
            return []
        if failed.attempts >= ATTEMPTS:
            return [self._drop(f"sound: the modem did not take it, {ATTEMPTS} times", failed.packet)]
        self._waiting.append(failed)
        self._waiting.sort(key=lambda it: (it.priority, it.number))
        return []

    def _enter(self, stage: Stage, for_ms: int | None = None) -> None:
        self.stage = stage
        self._until_ms = None if for_ms is None else self._now_ms + for_ms

    def _drop(self, reason: str, packet: Addressed | None) -> Dropped:
        self.dropped[reason] += 1
        return Dropped(self._now_ms, reason, packet)


def _same(waiting: _Waiting, packet: Addressed) -> bool:
    other = waiting.packet
    return (
        waiting.priority is Priority.REPORT
        and other.agent_id == packet.agent_id
        and other.way is packet.way is Way.FROM_AMUSSEL
    )
