"""A console that speaks IMC and gives one order: stop the plan under way.

    python imc_stop.py PORT    (it is the console 0x4001 at this port of 127.0.0.1)

It prints `warm` when the gateway has spoken, sends a PlanControl after a line of standard input, prints the answer and
ends with 0 for SUCCESS. Packed by hand after the IMC manual 5.4 (header, CRC-16-IBM, PlanControl 559).
"""

from __future__ import annotations

import select
import socket
import struct
import sys
import time

SYNC, PLAN_CONTROL = 0xFE54, 559
CONSOLE = 0x4001
REQUEST, SUCCESS, FAILURE = 0, 1, 2
STOP = 1
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


def plan_stop(target: int) -> bytes:
    text = struct.pack(">H", 0)
    body = struct.pack(">BBH", REQUEST, STOP, REQUEST_ID) + text + struct.pack(">HH", 0, NO_MESSAGE) + text
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
    link.sendto(plan_stop(first[1]), gateway)
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
