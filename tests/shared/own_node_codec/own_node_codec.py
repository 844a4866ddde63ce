"""The bytes of our own nodes (tests/counterparts/own_node/layout.txt) for musselbed's bridge."""

import struct
from math import cos, radians

from firmware_model.packets import CommandPacket, Kind, Packet, StatusPacket
from firmware_model.states import State

AMUSSELS = {201: 13, 202: 14, 203: 15, 207: 7}
NUMBERS = {agent_id: number for number, agent_id in AMUSSELS.items()} | {0: 0}
STATES = {"B": State.SLEEPING, "T": State.FLOATING, "L": State.CHARGING, "X": State.EMPTY}
WORDS = {Kind.PERMISSION: "RISE", Kind.RELEASE: "FREE", Kind.PING: "TELL"}
ORIGIN_DEG = 43.9330937, 15.4443468
"""The scenario's: a codec is not given it."""
EQUATOR_M, ECCENTRICITY_2 = 6378137.0, 0.00669437999014
WHOLE = struct.Struct(">BBHiiBIH")


def metres_per_degree(latitude_deg: float) -> tuple[float, float]:
    """The ellipsoid's radii of curvature at the origin."""
    flat = 1 - ECCENTRICITY_2 * (1 - cos(radians(latitude_deg)) ** 2)
    north = EQUATOR_M * (1 - ECCENTRICITY_2) / flat**1.5
    east = EQUATOR_M / flat**0.5 * cos(radians(latitude_deg))
    return radians(north), radians(east)


class OwnNode:
    def __init__(self) -> None:
        self._counts: dict[int, int] = {}

    def encode(self, packet: Packet) -> bytes:
        if (
            not isinstance(packet, CommandPacket)
            or packet.kind not in WORDS
            or packet.agent_id not in NUMBERS
        ):
            return b""
        return f"{WORDS[packet.kind]} {NUMBERS[packet.agent_id]}\n".encode()

    def decode(self, data: bytes) -> Packet | None:
        if len(data) != WHOLE.size or fletcher16(data[:-2]) != int.from_bytes(data[-2:], "big"):
            return None
        magic, number, millivolts, latitude, longitude, letter, tenths, _ = WHOLE.unpack(data)
        if magic != 0xA7 or number not in AMUSSELS or chr(letter) not in STATES:
            return None
        count = self._counts[number] = self._counts.get(number, -1) + 1
        north, east = metres_per_degree(ORIGIN_DEG[0])
        return StatusPacket(
            AMUSSELS[number],
            count % 65536,
            STATES[chr(letter)],
            min(1.0, max(0.0, (millivolts - 3600) / 600)),
            1.0,
            (latitude / 1e7 - ORIGIN_DEG[0]) * north,
            (longitude / 1e7 - ORIGIN_DEG[1]) * east,
            0.0,
            tenths * 100,
        )


def fletcher16(data: bytes) -> int:
    low = high = 0
    for byte in data:
        low = (low + byte) % 255
        high = (high + low) % 255
    return high << 8 | low
