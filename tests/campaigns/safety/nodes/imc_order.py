"""A console that speaks IMC and gives one order: stop the plan under way, or start one that goes to a place.

    python imc_order.py PORT [LATITUDE LONGITUDE]    (it is the console 0x4001 at this port of 127.0.0.1; degrees)

It prints `warm` when the gateway has spoken, sends a PlanControl after a line of standard input, prints the answer and
ends with 0 for SUCCESS. Packed by hand after the IMC manual 5.4 (header, CRC-16-IBM, PlanControl 559, Goto 450).
"""

from __future__ import annotations

import math
import select
import socket
import struct
import sys
import time

SYNC, PLAN_CONTROL, GO_TO = 0xFE54, 559, 450
CONSOLE = 0x4001
REQUEST, SUCCESS, FAILURE = 0, 1, 2
START, STOP = 0, 1
NO_MESSAGE = 0xFFFF
REQUEST_ID = 4711
PATIENCE_S = 20.0
HEADER, FOOTER_BYTES = struct.Struct(">HHHdHBHB"), 2


def crc(data: bytes) -> int:
    """CRC-16-IBM: the polynomial 0x8005 from the least bit on, begun at 0."""
    value = 0
    for byte in data:
        value ^= byte
        for _ in range(8):
            value = value >> 1 ^ (0xA001 if value & 1 else 0)
    return value


def plan_control(target: int, place_deg: tuple[float, float] | None) -> bytes:
    """A request to stop, or to start a plan that is a Goto at half a metre a second."""
    text, operation, plan = struct.pack(">H", 0), STOP, struct.pack(">H", NO_MESSAGE)
    if place_deg is not None:
        north_rad, east_rad = map(math.radians, place_deg)
        operation = START
        plan = struct.pack(">HHddfBfB3d", GO_TO, 0, north_rad, east_rad, 0.0, 0, 0.5, 0, 0.0, 0.0, 0.0) + text
    body = struct.pack(">BBH", REQUEST, operation, REQUEST_ID) + text + struct.pack(">H", 0) + plan + text
    packet = HEADER.pack(SYNC, PLAN_CONTROL, len(body), time.time(), CONSOLE, 255, target, 255) + body
    return packet + struct.pack(">H", crc(packet))


def header_of(packet: bytes) -> tuple[int, int, bytes] | None:
    """(message, sender, body) of a packet of either byte order."""
    for layout in (HEADER, struct.Struct(HEADER.format.replace(">", "<"))):
        sync, kind, _, _, source, *_ = layout.unpack_from(packet)
        if sync == SYNC:
            return kind, source, packet[HEADER.size : -FOOTER_BYTES]
    return None


def main() -> int:
    link = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    link.bind(("127.0.0.1", int(sys.argv[1])))
    link.settimeout(PATIENCE_S)
    packet, gateway = link.recvfrom(2**16)
    first = header_of(packet)
    assert first is not None
    print("warm", flush=True)
    sys.stdin.readline()
    while select.select([link], [], [], 0)[0]:  # what came while it waited
        link.recv(2**16)
    place = (float(sys.argv[2]), float(sys.argv[3])) if len(sys.argv) > 2 else None
    link.sendto(plan_control(first[1], place), gateway)
    until_s = time.monotonic() + PATIENCE_S
    while time.monotonic() < until_s:
        said = header_of(link.recv(2**16))
        if said is not None and said[0] == PLAN_CONTROL:
            kind = said[2][0]
            if kind in (SUCCESS, FAILURE):
                print("IMC", "success" if kind == SUCCESS else "failure", said[2][-120:])
                return 0 if kind == SUCCESS else 3
    return 3


if __name__ == "__main__":
    sys.exit(main())
