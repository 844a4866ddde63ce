"""Puts the messages and calls of ROS 1 nodes together from the IP packets of an interface.

TCPROS (wiki.ros.org/ROS/TCPROS): the one who opens a connection sends a header of fields, the other answers with one. Then
a topic's publisher sends records, a length and so many bytes; a service's client sends records too, and each answer is a
byte (1: done, 0: refused) before its record. Standard library only: a judge shares no code with what it judges.
"""

from __future__ import annotations

import socket
import struct
from collections import deque
from dataclasses import dataclass, field

_TCP = 6
_SYN = 0x02
_LONGEST_HEADER = 100_000
"""Bytes. XML-RPC begins with letters, which are a far greater length."""
_MOST_WAITING = 512
"""Segments beyond a gap. A packet that the network lost is sent again; one that this reader missed is not."""

End = tuple[str, int]


class PacketsMissed(Exception):
    """Packets were lost to the reader: what it says from then on would not be the whole."""


@dataclass(frozen=True, slots=True)
class Message:
    """A message on a topic; `to` and `by` are the names of the subscriber and the publisher."""

    topic: str
    by: str
    to: str
    data: bytes


@dataclass(frozen=True, slots=True)
class Call:
    """A service's request. Its number is the same in its `Answer`."""

    number: int
    service: str
    by: str
    data: bytes


@dataclass(frozen=True, slots=True)
class Answer:
    """`ok` is False for a call that the service refused with an error, whose text is `data`."""

    number: int
    service: str
    by: str
    ok: bool
    data: bytes


Heard = Message | Call | Answer


@dataclass(slots=True)
class Stream:
    """One direction of a TCP connection: its bytes in their order, each once."""

    next: int
    rest: bytes = b""
    waiting: dict[int, bytes] = field(default_factory=dict)

    def take(self, sequence: int, data: bytes) -> None:
        if data:
            known = self.waiting.get(sequence, b"")
            self.waiting[sequence] = max(known, data, key=len)
        while early := [it for it in self.waiting if (self.next - it) % 2**32 < 2**31]:
            for start in early:
                new = self.waiting.pop(start)[(self.next - start) % 2**32 :]
                self.rest += new
                self.next = (self.next + len(new)) % 2**32
        if len(self.waiting) > _MOST_WAITING:
            raise PacketsMissed(f"{len(self.waiting)} segments wait for one that never came")

    def record(self, before: int = 0) -> tuple[bytes, bytes] | None:
        """The next whole record, with the `before` bytes that stand before its length; None while it is not whole."""
        if len(self.rest) < before + 4:
            return None
        end = before + 4 + struct.unpack_from("<I", self.rest, before)[0]
        if len(self.rest) < end:
            return None
        whole, self.rest = self.rest[:end], self.rest[end:]
        return whole[:before], whole[before + 4 :]

    @property
    def is_no_tcpros(self) -> bool:
        return len(self.rest) >= 4 and struct.unpack_from("<I", self.rest)[0] > _LONGEST_HEADER


@dataclass(slots=True)
class Connection:
    """A TCP connection from its first packet on; the fields of both ends as soon as they were said."""

    client: Stream
    server: Stream | None = None
    of_client: dict[str, str] | None = None
    of_server: dict[str, str] | None = None
    unanswered: deque[int] = field(default_factory=deque)
    is_other: bool = False
    """No TCPROS, or a question of a client that wants to know a service's type alone."""


class Reader:
    """Takes IP packets (RFC 791) with TCP segments (RFC 9293), and returns what was said when it is whole.

    A connection that was there before the reader is not read.
    """

    def __init__(self) -> None:
        self._connections: dict[tuple[End, End], Connection] = {}
        self._calls = 0

    def take(self, packet: bytes) -> list[Heard]:
        if len(packet) < 20 or packet[0] >> 4 != 4 or packet[9] != _TCP:
            return []
        segment = packet[4 * (packet[0] & 15) : struct.unpack_from("!H", packet, 2)[0]]
        source, target, sequence = struct.unpack_from("!HHI", segment)
        data, flags = segment[4 * (segment[12] >> 4) :], segment[13]
        sender = socket.inet_ntoa(packet[12:16]), source
        receiver = socket.inet_ntoa(packet[16:20]), target
        if flags & _SYN:
            self._open(sender, receiver, (sequence + 1) % 2**32)
        elif (it := self._connections.get((sender, receiver))) is not None and not it.is_other:
            it.client.take(sequence, data)
            return self._of_client(it)
        elif (it := self._connections.get((receiver, sender))) and it.server and not it.is_other:
            it.server.take(sequence, data)
            return self._of_server(it)
        return []

    def _open(self, sender: End, receiver: End, sequence: int) -> None:
        if (opened := self._connections.get((receiver, sender))) is not None:
            if opened.server is None:
                opened.server = Stream(sequence)
        elif (known := self._connections.get((sender, receiver))) is None or known.client.next != sequence:
            self._connections[sender, receiver] = Connection(Stream(sequence))

    def _of_client(self, it: Connection) -> list[Heard]:
        heard: list[Heard] = []
        if it.of_client is None:
            if it.client.is_no_tcpros:
                it.is_other = True
            if it.is_other or (header := it.client.record()) is None:
                return heard
            it.of_client = fields_of(header[1])
            it.is_other = "probe" in it.of_client
        while "service" in it.of_client and not it.is_other and (record := it.client.record()) is not None:
            self._calls += 1
            it.unanswered.append(self._calls)
            heard.append(
                Call(self._calls, it.of_client["service"], it.of_client.get("callerid", ""), record[1])
            )
        return heard

    def _of_server(self, it: Connection) -> list[Heard]:
        heard: list[Heard] = []
        if it.of_client is None or it.server is None:
            return heard
        if it.of_server is None:
            if (header := it.server.record()) is None:
                return heard
            it.of_server = fields_of(header[1])
        by, to = it.of_server.get("callerid", ""), it.of_client.get("callerid", "")
        if "topic" in it.of_client:
            while (record := it.server.record()) is not None:
                heard.append(Message(it.of_client["topic"], by, to, record[1]))
        elif "service" in it.of_client:
            while it.unanswered and (record := it.server.record(before=1)) is not None:
                number = it.unanswered.popleft()
                heard.append(Answer(number, it.of_client["service"], to, record[0] == b"\1", record[1]))
        return heard


def fields_of(header: bytes) -> dict[str, str]:
    """The fields of a connection's header: each a length and NAME=VALUE."""
    fields, at = {}, 0
    while at + 4 <= len(header):
        (length,) = struct.unpack_from("<I", header, at)
        name, _, value = header[at + 4 : at + 4 + length].decode(errors="replace").partition("=")
        fields[name] = value
        at += 4 + length
    return fields
