"""Three bytes before a packet that travels by a modem which is nobody's in particular: which way, and of whom it is.

One physical modem speaks for a whole fleet. It has one address of its own, and what it hears as a unicast names no sender:
so the aMussel's id travels in the payload, little-endian after a byte that says whether the aMussel speaks or is spoken to.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from enum import IntEnum

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
