"""The built-in wire layout, version 1: little-endian, version and kind first, CRC-16/CCITT last.

The swarm's own layout is not public; a laboratory's replaces this one through `firmware_model.codec`. Positions travel as
local NED centimetres, charge as 1/65535 of the paper's scaled range.
"""

from __future__ import annotations

import struct
from binascii import crc_hqx
from dataclasses import dataclass
from enum import IntEnum
from typing import ClassVar

from firmware_model.states import State

VERSION = 1
_CHARGE_STEPS = 65535
_COMMANDS = (2, 3, 4, 5)
_STATES = {int(state): state for state in State}


class Kind(IntEnum):
    STATUS = 1
    PERMISSION = 2
    RELEASE = 3
    PING = 4
    HOVER = 5


def _sealed(body: bytes) -> bytes:
    return body + struct.pack("<H", crc_hqx(body, 0xFFFF))


@dataclass(frozen=True, slots=True)
class StatusPacket:
    """An aMussel's word about itself. `sequence` counts its reports modulo 65536; `agent_ms` is its own time."""

    FORMAT: ClassVar[struct.Struct] = struct.Struct("<BBHHBHHiiHQ")

    agent_id: int
    sequence: int
    state: State
    primary: float
    secondary: float
    north_m: float
    east_m: float
    depth_m: float
    agent_ms: int

    def encode(self) -> bytes:
        return _sealed(
            self.FORMAT.pack(
                VERSION,
                Kind.STATUS,
                self.agent_id,
                self.sequence & 0xFFFF,
                self.state,
                round(self.primary * _CHARGE_STEPS),
                round(self.secondary * _CHARGE_STEPS),
                round(self.north_m * 100),
                round(self.east_m * 100),
                min(0xFFFF, round(self.depth_m * 100)),
                self.agent_ms,
            )
        )


@dataclass(frozen=True, slots=True)
class CommandPacket:
    """An aPad's word to one aMussel: PERMISSION to surface, RELEASE (it is clear to sink), PING (wake up and listen) or
    HOVER (hold a depth)."""

    FORMAT: ClassVar[struct.Struct] = struct.Struct("<BBH")

    kind: Kind
    agent_id: int

    def encode(self) -> bytes:
        return _sealed(self.FORMAT.pack(VERSION, self.kind, self.agent_id))


Packet = StatusPacket | CommandPacket


def decode(data: bytes) -> Packet | None:
    """The packet, or None for anything that is not a whole, unharmed one of this version."""
    if len(data) < 4 or data[0] != VERSION:
        return None
    body = data[:-2]
    if crc_hqx(body, 0xFFFF) != int.from_bytes(data[-2:], "little"):
        return None
    if body[1] == Kind.STATUS and len(body) == StatusPacket.FORMAT.size:
        _, _, agent_id, sequence, state, primary, secondary, north, east, depth, agent_ms = (
            StatusPacket.FORMAT.unpack(body)
        )
        known = _STATES.get(state)
        if known is None:
            return None
        return StatusPacket(
            agent_id,
            sequence,
            known,
            primary / _CHARGE_STEPS,
            secondary / _CHARGE_STEPS,
            north / 100,
            east / 100,
            depth / 100,
            agent_ms,
        )
    if body[1] in _COMMANDS and len(body) == CommandPacket.FORMAT.size:
        return CommandPacket(Kind(body[1]), struct.unpack_from("<H", body, 2)[0])
    return None
