"""Reads an aPad's wire: every TCP packet on its machine's interfaces, and what ROS nodes say to each other in them.

    python wire_reader.py ADDRESS APAD     (on that machine, as its root, before any node starts; APAD is a namespace)

It is no node, and nobody knows of it. It prints `reading`; then a line of JSON for each position that leaves the aPad, as
the watchdog beside it receives it, and for each order that arrives, whoever gives it: a goal of generation A, a call of
generation B. `at_s` is the monotonic clock's. It ends with exit code 1 when packets were lost to it: then nothing is known.
"""

from __future__ import annotations

import json
import socket
import struct
import sys
import time
from dataclasses import dataclass, field
from typing import Any

from apad_bridge.ros.types.messages import use_generated_messages

use_generated_messages()

from apad.msg import aPadActionGoal  # noqa: E402
from auv_msgs.msg import NavSts  # noqa: E402
from misc_msgs.srv import (  # noqa: E402
    DynamicPositioningPrimitiveServiceRequest,
    Go2pointPrimitiveServiceRequest,
)

_ALL_PACKETS = 0x0003
"""ETH_P_ALL (packet(7)): what arrives and what leaves."""
_BUFFER_BYTES = 2**22
_LONGEST_HEADER = 100_000
_MOST_WAITING = 64
"""Segments beyond a gap. The next one on its way again fills it, unless the packet was lost to this reader alone."""
_TCP = 6
_SYN = 0x02

End = tuple[str, int]


@dataclass(slots=True)
class Direction:
    """The bytes of one direction of a connection in their order, and the TCPROS records in them: a length, and so much."""

    next: int
    waiting: dict[int, bytes] = field(default_factory=dict)
    rest: bytes = b""

    def take(self, sequence: int, data: bytes) -> list[bytes]:
        """The records that are whole now."""
        if data:
            self.waiting[sequence] = data
        if len(self.waiting) > _MOST_WAITING:
            raise SystemExit("wire_reader: packets were lost to it")
        while early := [it for it in self.waiting if (self.next - it) % 2**32 < 2**31]:
            for start in early:
                known = (self.next - start) % 2**32
                new = self.waiting.pop(start)[known:]
                self.rest += new
                self.next = (self.next + len(new)) % 2**32
        records = []
        while len(self.rest) >= 4 and len(self.rest) >= 4 + (
            length := struct.unpack_from("<I", self.rest)[0]
        ):
            records.append(self.rest[4 : 4 + length])
            self.rest = self.rest[4 + length :]
        return records


@dataclass(slots=True)
class Connection:
    """A connection between two nodes, from its first packet on; `header` are the fields of the one who opened it."""

    to_server: Direction
    to_client: Direction | None = None
    header: dict[str, str] | None = None
    by: str = ""
    """The node at the server's end."""
    is_other: bool = False
    """No TCPROS, or nothing that is read here."""


class Wire:
    def __init__(self, address: str, apad: str) -> None:
        self._address, self._apad = address, apad
        self._connections: dict[tuple[End, End], Connection] = {}

    def take(self, packet: bytes) -> None:
        """An IP packet (RFC 791) with a TCP segment (RFC 9293) in it."""
        if packet[0] >> 4 != 4 or packet[9] != _TCP:
            return
        segment = packet[4 * (packet[0] & 15) : struct.unpack_from("!H", packet, 2)[0]]
        source, target, sequence = struct.unpack_from("!HHI", segment)
        data, flags = segment[4 * (segment[12] >> 4) :], segment[13]
        sender = socket.inet_ntoa(packet[12:16]), source
        receiver = socket.inet_ntoa(packet[16:20]), target
        if flags & _SYN:
            self._open(sender, receiver, (sequence + 1) % 2**32)
        elif (it := self._connections.get((sender, receiver))) is not None and not it.is_other:
            self._take_of_client(it, it.to_server.take(sequence, data), receiver)
        elif (it := self._connections.get((receiver, sender))) and it.to_client and not it.is_other:
            self._take_of_server(it, it.to_client.take(sequence, data), receiver, sender)

    def _open(self, sender: End, receiver: End, sequence: int) -> None:
        if (opened := self._connections.get((receiver, sender))) is not None:
            if opened.to_client is None:
                opened.to_client = Direction(sequence)
        elif (known := self._connections.get((sender, receiver))) is None or known.to_server.next != sequence:
            self._connections[sender, receiver] = Connection(Direction(sequence))

    def _take_of_client(self, it: Connection, records: list[bytes], server: End) -> None:
        if it.header is None and records:
            it.header = fields_of(records.pop(0))
            it.is_other = not self._is_read(it.header)
        elif len(it.to_server.rest) >= 4 and struct.unpack_from("<I", it.to_server.rest)[0] > _LONGEST_HEADER:
            it.is_other = True  # XML-RPC begins with letters
        if it.header is None or it.is_other or server[0] != self._address:
            return
        for record in records:
            self._tell_call(it.header["service"], it.header["callerid"], record)

    def _take_of_server(self, it: Connection, records: list[bytes], client: End, server: End) -> None:
        if it.header is None or "topic" not in it.header or client[0] != self._address:
            return
        if not it.by and records:
            it.by = fields_of(records.pop(0))["callerid"]
        for record in records:
            if it.header["topic"] == f"{self._apad}/action_server/goal":
                self._tell_goal(it.by, record)
            elif server[0] == self._address:
                self._tell_position(record)

    def _is_read(self, header: dict[str, str]) -> bool:
        if "probe" in header:
            return False
        topics = f"{self._apad}/position", f"{self._apad}/action_server/goal"
        return header.get("topic") in topics or header.get("service", "").startswith(
            f"{self._apad}/commander/"
        )

    def _tell_position(self, record: bytes) -> None:
        position = NavSts().deserialize(record)
        yaw = position.orientation.yaw
        tell(position_m=(position.position.north, position.position.east), heading_rad=yaw)

    def _tell_goal(self, by: str, record: bytes) -> None:
        goal = aPadActionGoal().deserialize(record).goal
        place_m = (goal.pose.position.x, goal.pose.position.y)
        tell(order=f"goal {goal.id}", by=by, place_m=place_m if goal.id == 0 else None)

    def _tell_call(self, service: str, by: str, record: bytes) -> None:
        order = service.removeprefix(f"{self._apad}/commander/")
        place_m = None
        if order == "primitive/go2point":
            point = Go2pointPrimitiveServiceRequest().deserialize(record).point
            place_m = (point.x, point.y)
        elif order == "primitive/dynamic_positioning":
            held = DynamicPositioningPrimitiveServiceRequest().deserialize(record)
            place_m = (held.north, held.east)
        tell(order=order, by=by, place_m=place_m)


def fields_of(header: bytes) -> dict[str, str]:
    """The fields of a connection header (wiki.ros.org/ROS/Connection Header)."""
    fields, at = {}, 0
    while at < len(header):
        (length,) = struct.unpack_from("<I", header, at)
        name, _, value = header[at + 4 : at + 4 + length].decode(errors="replace").partition("=")
        fields[name] = value
        at += 4 + length
    return fields


def tell(**facts: Any) -> None:
    print(json.dumps({"at_s": time.monotonic(), **facts}), flush=True)


def main() -> None:
    wire = Wire(sys.argv[1], sys.argv[2])
    # SOCK_DGRAM: without the link's own header, which differs between the loopback and a TUN device.
    with socket.socket(socket.AF_PACKET, socket.SOCK_DGRAM, socket.htons(_ALL_PACKETS)) as packets:
        packets.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _BUFFER_BYTES)
        print("reading", flush=True)
        while True:
            packet, (_, protocol, *_) = packets.recvfrom(2**17)
            if protocol == 0x0800:
                wire.take(packet)


if __name__ == "__main__":
    main()
