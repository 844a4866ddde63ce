"""Drives a physical V3 nanomodem that sends and receives for a whole fleet: its packets, its queue and its answers.

The modem has one address of its own, and a unicast that it receives names no sender. So a header of three bytes precedes
each packet: the direction (from or to the aMussel), and the aMussel's id, little-endian. Nodes whose packets name their
sender need none (`Framing.BARE`).

The queue gives the modem one command at a time: a broadcast, or a ping. It sends no unicasts, because only a modem with
address 24 would receive a unicast to aMussel 24. The modem's address is read and shown, and never written. A ping measures
the range from where this modem hangs to the modem whose address is the aMussel's id. The queue drops every other range.

    CLOSED -> IDENTIFYING -> READY -> AWAITING_ACCEPTANCE -> SENDING, or RANGING -> READY
    any -> CLOSED when the port is lost

The modem's answers are read by counting bytes, because the data of a message may hold any byte.
"""

from __future__ import annotations

import re
import struct
from collections import Counter
from dataclasses import dataclass
from enum import Enum, IntEnum

from agents.modem.answers import FOUND
from agents.modem.frames import ADDRESSES, PAYLOAD_BYTES, ModemGeneration, duration_ms
from agents.water.apad_modem import ANSWER_TIMEOUT_MS
from firmware_model.packets import EVERYONE

_FORMAT = struct.Struct("<BH")
HEADER_BYTES = _FORMAT.size
MAX_WAITING = 64
"""The most packets that wait, of all priorities: at half a second each, a packet behind more would be sent too late."""
WAIT_MS = 30_000
"""A packet that has waited longer is dropped."""
ANSWER_MS = 1_000
"""The timeout of an answer; a modem answers within some 80 ms."""
ATTEMPTS = 3
PING_ADDRESSES = range(1, ADDRESSES)
"""The ids of aMussels that may be a modem's address."""
_TURNAROUND_MS = 20
_FEWEST, _MOST = PAYLOAD_BYTES[ModemGeneration.V3]
_LINE_BYTES = 120
"""Longer than any answer that is only text, except the help, which is never requested here."""
_QUALITY = re.compile(rb"Q\d\d(D[+-]\d{3})?")
_TIME = re.compile(rb"T\d{14}")
_MESSAGE = re.compile(rb"#(?:B(\d{3})|U)(\d\d)")


class PacketDirection(IntEnum):
    FROM_AMUSSEL = 0xB1
    TO_AMUSSEL = 0xB2


_DIRECTIONS = {int(direction): direction for direction in PacketDirection}


@dataclass(frozen=True, slots=True)
class RoutedPacket:
    """A packet with its aMussel and direction; `agent_id` is up to 65535."""

    direction: PacketDirection
    agent_id: int
    data: bytes


class Framing(Enum):
    """The bytes on the modem around a packet; the value is the size of the header."""

    HEADER = HEADER_BYTES
    BARE = 0
    """The packet's bytes alone: only they tell the direction, and whose they are."""

    def encode(self, packet: RoutedPacket) -> bytes:
        if self is Framing.BARE:
            return packet.data
        return _FORMAT.pack(packet.direction, packet.agent_id) + packet.data

    def decode(self, payload: bytes) -> RoutedPacket | None:
        """The packet in a received payload; None for bytes without the header. A bare one has EVERYONE for its id."""
        if self is Framing.BARE:
            return RoutedPacket(PacketDirection.FROM_AMUSSEL, EVERYONE, payload)
        if len(payload) <= HEADER_BYTES:
            return None
        direction, agent_id = _FORMAT.unpack_from(payload)
        known = _DIRECTIONS.get(direction)
        return None if known is None else RoutedPacket(known, agent_id, payload[HEADER_BYTES:])


class Priority(IntEnum):
    """Orders the waiting packets; within a priority the oldest goes first."""

    COMMAND = 0
    PING = 1
    REPORT = 2


class ModemStage(Enum):
    CLOSED = "closed"
    IDENTIFYING = "identifying"
    READY = "ready"
    AWAITING_ACCEPTANCE = "awaiting acceptance"
    SENDING = "sending"
    RANGING = "ranging"


@dataclass(frozen=True, slots=True)
class WriteLine:
    """Bytes for the serial port."""

    data: bytes


@dataclass(frozen=True, slots=True)
class PacketSent:
    """The packet was sent completely: its last sound left at `at_ms`."""

    at_ms: int
    packet: RoutedPacket


@dataclass(frozen=True, slots=True)
class PacketReceived:
    """A packet was received."""

    at_ms: int
    packet: RoutedPacket


@dataclass(frozen=True, slots=True)
class ModemRanged:
    """The modem whose address is `agent_id` answered a ping. `steps` are 31.25 us of sound each, one way."""

    at_ms: int
    agent_id: int
    steps: int


@dataclass(frozen=True, slots=True)
class PacketDropped:
    """A packet, or an answer of the modem, was dropped. A ping is a packet without data."""

    at_ms: int
    reason: str
    packet: RoutedPacket | None = None


@dataclass(frozen=True, slots=True)
class ModemNotice:
    """A line for a person: the modem was found with its address, or was lost."""

    at_ms: int
    what: str


NanomodemAction = WriteLine | PacketSent | PacketReceived | ModemRanged | PacketDropped | ModemNotice


@dataclass(slots=True)
class _Waiting:
    priority: Priority
    number: int
    since_ms: int
    packet: RoutedPacket
    command: bytes
    """Its first `acceptance_bytes` are the modem's answer."""
    acceptance_bytes: int
    lasting_ms: int
    """The time from the acceptance to the last sound; for a ping, to the latest answer."""
    attempts: int = 0


class ModemQueue:
    """The queue of packets for the modem. It begins without a port.

    Times are mission milliseconds, which are real ones: sound cannot be accelerated.
    """

    def __init__(self, now_ms: int = 0, framing: Framing = Framing.HEADER) -> None:
        self.stage = ModemStage.CLOSED
        self.address: int | None = None
        """The modem's own address, as it reported it."""
        self.dropped: Counter[str] = Counter()
        self._now_ms = now_ms
        self._framing = framing
        self._reader = AnswerReader()
        self._waiting: list[_Waiting] = []
        self._sending: _Waiting | None = None
        self._until_ms: int | None = None
        """The timeout of the present stage; the end of SENDING."""
        self._number = 0

    @property
    def waiting(self) -> int:
        """The number of waiting packets, without the packet that is being sent."""
        return len(self._waiting)

    @property
    def skipped_bytes(self) -> int:
        """Bytes of the modem that belonged to no answer."""
        return self._reader.skipped_bytes

    @property
    def next_due_ms(self) -> int | None:
        dues = [it.since_ms + WAIT_MS for it in self._waiting]
        if self._until_ms is not None:
            dues.append(self._until_ms)
        return max(self._now_ms, min(dues)) if dues else None

    def advance(self, now_ms: int) -> list[NanomodemAction]:
        """Lets time pass to `now_ms`, in order (ValueError if it went back)."""
        if now_ms < self._now_ms:
            raise ValueError(f"time went back: {now_ms} before {self._now_ms}")
        actions: list[NanomodemAction] = []
        while (due_ms := self.next_due_ms) is not None and due_ms <= now_ms:
            self._now_ms = due_ms
            if self._until_ms is not None and self._until_ms <= due_ms:
                actions += self._stage_ended()
            for late in [it for it in self._waiting if it.since_ms + WAIT_MS <= due_ms]:
                self._waiting.remove(late)
                actions.append(self._drop("sound: waited too long for the modem", late.packet))
        self._now_ms = now_ms
        return actions

    def send(self, packet: RoutedPacket, priority: Priority, now_ms: int) -> list[NanomodemAction]:
        """Queues a packet. A report replaces an older waiting report of the same aMussel."""
        actions = self.advance(now_ms)
        payload = self._framing.encode(packet)
        if not _FEWEST <= len(payload) <= _MOST:
            besides = " besides the id" if self._framing is Framing.HEADER else ""
            reason = f"sound: more than the {_MOST - self._framing.value} bytes that a modem carries{besides}"
            if len(packet.data) < _FEWEST:
                reason = f"sound: fewer than the {_FEWEST} bytes that a modem carries"
            return [*actions, self._drop(reason, packet)]
        if priority is Priority.REPORT:
            for older in [it for it in self._waiting if _is_superseded_by(it, packet)]:
                self._waiting.remove(older)
                actions.append(self._drop("sound: overtaken by a newer report", older.packet))
        command = b"$B%02d" % len(payload)
        lasting_ms = duration_ms(ModemGeneration.V3, len(payload)) + _TURNAROUND_MS
        return actions + self._queue(priority, packet, command + payload, len(command), lasting_ms)

    def ping(self, agent_id: int, now_ms: int) -> list[NanomodemAction]:
        """Queues a ping, before all reports. Nothing else is sent until it is answered or the modem has given it up."""
        actions, packet = self.advance(now_ms), RoutedPacket(PacketDirection.TO_AMUSSEL, agent_id, b"")
        if agent_id not in PING_ADDRESSES:
            return [
                *actions,
                self._drop("sound: a ping of an id that is no modem's address (1 to 255)", packet),
            ]
        command, lasting_ms = b"$P%03d" % agent_id, duration_ms(ModemGeneration.V3, 0) + ANSWER_TIMEOUT_MS
        return actions + self._queue(Priority.PING, packet, command, len(command), lasting_ms + ANSWER_MS)

    def port_opened(self, now_ms: int) -> list[NanomodemAction]:
        """The port was opened, perhaps again: asks the modem for its address."""
        return self.advance(now_ms) + self._identify()

    def port_lost(self, why: str, now_ms: int) -> list[NanomodemAction]:
        """The port was lost. The packet being sent is retried when the port is back; waiting packets stay queued."""
        actions = self.advance(now_ms)
        if self.stage is ModemStage.CLOSED:
            return actions
        self._enter(ModemStage.CLOSED)
        actions.append(ModemNotice(now_ms, f"the modem is gone, and its port is tried again: {why}"))
        return actions + self._retry()

    def read(self, data: bytes, now_ms: int) -> list[NanomodemAction]:
        """Takes bytes that the modem has printed."""
        actions = self.advance(now_ms)
        for answer in self._reader.take(data):
            actions += self._receive(answer) if isinstance(answer, ReceivedData) else self._answer(answer)
        return actions

    def _receive(self, message: ReceivedData) -> list[NanomodemAction]:
        if (packet := self._framing.decode(message.data)) is None:
            return [self._drop("sound: without an aMussel's id", None)]
        return [PacketReceived(self._now_ms, packet)]

    def _answer(self, line: Line) -> list[NanomodemAction]:
        text = line.text
        if text.startswith(b"#A") and text[2:5].isdigit():
            self.address = int(text[2:5])
            if self.stage is not ModemStage.IDENTIFYING:
                return []
            self._enter(ModemStage.READY)
            return [
                ModemNotice(self._now_ms, f"the modem is there, with address {self.address}"),
                *self._send_next(),
            ]
        if (
            self.stage is ModemStage.AWAITING_ACCEPTANCE
            and self._sending is not None
            and text == self._sending.command[: self._sending.acceptance_bytes]
        ):
            is_ping = self._sending.priority is Priority.PING
            self._enter(ModemStage.RANGING if is_ping else ModemStage.SENDING, self._sending.lasting_ms)
            return []
        if self.stage is ModemStage.RANGING and self._sending is not None:
            pinged = self._sending.packet
            if text == b"#TO":
                return self._ended(self._drop("sound: a ping that was not answered", pinged))
            if (found := FOUND.fullmatch(text)) is not None and int(found[1]) == pinged.agent_id:
                return self._ended(ModemRanged(self._now_ms, pinged.agent_id, int(found[2])))
        if text == b"E" and self.stage is ModemStage.AWAITING_ACCEPTANCE:
            self._enter(ModemStage.READY)
            return [*self._retry(), *self._send_next()]
        if text == b"$W" and self.stage is ModemStage.IDENTIFYING:
            return []
        if text.startswith(b"#R") or text == b"#TO":
            return [self._drop("sound: a range that was not asked for", None)]
        return [self._drop("modem: an answer to nothing that was asked", None)]

    def _stage_ended(self) -> list[NanomodemAction]:
        """Acts on the end of the present stage's time."""
        if self.stage is ModemStage.SENDING and self._sending is not None:
            return self._ended(PacketSent(self._now_ms - _TURNAROUND_MS, self._sending.packet))
        # Without an answer, the modem may have been exchanged, or may sleep.
        return [*self._retry(), *self._identify()]

    def _queue(
        self, priority: Priority, packet: RoutedPacket, command: bytes, acceptance_bytes: int, lasting_ms: int
    ) -> list[NanomodemAction]:
        self._number += 1
        self._waiting.append(
            _Waiting(
                priority, self._number, self._now_ms, packet, command, acceptance_bytes, lasting_ms=lasting_ms
            )
        )
        self._waiting.sort(key=lambda it: (it.priority, it.number))
        is_full = len(self._waiting) > MAX_WAITING
        dropped = (
            [self._drop("sound: the modem's queue is full", self._waiting.pop().packet)] if is_full else []
        )
        return [*dropped, *self._send_next()]

    def _identify(self) -> list[NanomodemAction]:
        """Asks the modem for its address. `$W`, repeated, wakes a sleeping modem. An incomplete answer is dropped."""
        self._reader.forget()
        self._enter(ModemStage.IDENTIFYING, ANSWER_MS)
        return [WriteLine(b"$W"), WriteLine(b"$?")]

    def _send_next(self) -> list[NanomodemAction]:
        if self.stage is not ModemStage.READY or not self._waiting:
            return []
        self._sending = self._waiting.pop(0)
        self._sending.attempts += 1
        self._enter(ModemStage.AWAITING_ACCEPTANCE, ANSWER_MS)
        return [WriteLine(self._sending.command)]

    def _ended(self, outcome: NanomodemAction) -> list[NanomodemAction]:
        """Ends the command that the modem has, with its outcome."""
        self._sending = None
        self._enter(ModemStage.READY)
        return [outcome, *self._send_next()]

    def _retry(self) -> list[NanomodemAction]:
        """Puts the packet being sent back to the head of its priority, or drops it after the last attempt."""
        failed, self._sending = self._sending, None
        if failed is None:
            return []
        if failed.attempts >= ATTEMPTS:
            return [self._drop(f"sound: the modem did not take it, {ATTEMPTS} times", failed.packet)]
        self._waiting.append(failed)
        self._waiting.sort(key=lambda it: (it.priority, it.number))
        return []

    def _enter(self, stage: ModemStage, for_ms: int | None = None) -> None:
        self.stage = stage
        self._until_ms = None if for_ms is None else self._now_ms + for_ms

    def _drop(self, reason: str, packet: RoutedPacket | None) -> PacketDropped:
        self.dropped[reason] += 1
        return PacketDropped(self._now_ms, reason, packet)


def _is_superseded_by(waiting: _Waiting, packet: RoutedPacket) -> bool:
    other = waiting.packet
    return (
        waiting.priority is Priority.REPORT
        and other.agent_id == packet.agent_id
        and other.direction is packet.direction is PacketDirection.FROM_AMUSSEL
    )


@dataclass(frozen=True, slots=True)
class ReceivedData:
    """Data from the water; a unicast has no source."""

    source: int | None
    data: bytes


@dataclass(frozen=True, slots=True)
class Line:
    """Any other answer, without its CR LF."""

    text: bytes


class AnswerReader:
    """Splits chunks of bytes into answers; `skipped_bytes` counts the bytes that belong to none."""

    def __init__(self) -> None:
        self.skipped_bytes = 0
        self._bytes = bytearray()

    def forget(self) -> None:
        """Drops an incomplete answer, which will not be continued."""
        self._bytes.clear()

    def take(self, data: bytes) -> list[ReceivedData | Line]:
        self._bytes += data
        answers: list[ReceivedData | Line] = []
        while (found := self._next()) is not None:
            answers.append(found)
        return answers

    def _next(self) -> ReceivedData | Line | None:
        self._skip_noise()
        taken = bytes(self._bytes)
        if taken[:2] in (b"#B", b"#U"):
            if (head := _MESSAGE.match(taken)) is not None:
                return self._message(taken, head)
            if len(taken) < (7 if taken[1:2] == b"B" else 4):
                return None
        end = taken.find(b"\r\n")
        if end < 0:
            return None
        del self._bytes[: end + 2]
        return Line(taken[:end])

    def _message(self, taken: bytes, head: re.Match[bytes]) -> ReceivedData | Line | None:
        """The message, once its end is there, or the answer behind a torn one. A quality and a time may follow its data."""
        size = int(head[2])
        rest = taken[head.end() + size :]
        at = 0
        for appended in (_QUALITY, _TIME):
            if (found := appended.match(rest, at)) is not None:
                at = found.end()
        if rest[at : at + 2] == b"\r\n":
            del self._bytes[: head.end() + size + at + 2]
            return ReceivedData(
                None if head[1] is None else int(head[1]), taken[head.end() : head.end() + size]
            )
        # There are enough bytes for the longest message but no end of it, so they are no message.
        if len(rest) >= 8 + 15 + 2:
            self._drop(1)
            return self._next()
        return None

    def _skip_noise(self) -> None:
        """Answers begin with `#`, `$` or `E`."""
        starts = [at for at in (self._bytes.find(first) for first in (b"#", b"$", b"E")) if at >= 0]
        self._drop(min(starts, default=len(self._bytes)))
        if len(self._bytes) > _LINE_BYTES and b"\r\n" not in self._bytes[:_LINE_BYTES]:
            self._drop(1)

    def _drop(self, count: int) -> None:
        self.skipped_bytes += count
        del self._bytes[:count]
