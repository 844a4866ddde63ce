"""The common part of all packets of the built-in layout: little-endian, version and kind first, CRC-16/CCITT last.

A version belongs to one kind's layout: a kind with a changed layout keeps its number under a higher version, and a receiver
that does not know the pair drops the packet. The CRC (polynomial 0x1021, start 0xFFFF) detects every single and double bit
error and every burst of up to 16 bits in packets of up to 4095 bytes.
"""

from __future__ import annotations

import struct
from binascii import crc_hqx
from enum import IntEnum
from typing import NamedTuple

from firmware_model.states import Trigger

CHARGE_STEPS = 65535
EVERYONE = 0
"""The id of a command to all that receive it; aMussels' own ids begin at 1."""
MAX_AGENT_ID = 0xFFFF
"""An id has two bytes."""

HEAD = struct.Struct("<BBH")
"""Version, kind, and the id of the aMussel that sends or receives."""
_CRC = struct.Struct("<H")


class Kind(IntEnum):
    STATUS = 1
    PERMISSION = 2
    RELEASE = 3
    PING = 4
    HOVER = 5
    SINK = 6
    SLEEP_SCHEDULE = 7
    SLOT_ASSIGNMENT = 8
    SET_THRESHOLD = 9
    BACK_UP_LOG = 10
    BEACON = 11
    LOG_ACK = 12
    ACOUSTIC_STATUS = 13
    WIFI_STATUS = 14
    LOG_RECORDS = 15


class PlainCommand(NamedTuple):
    """A command without arguments. The codec, the boards' benches, a script of `musselbed mu` and aPads follow from it."""

    version: int
    """The layout version that introduced it."""
    trigger: Trigger | None
    """Its trigger of the transition table; None where no state takes it."""
    meaning: str
    in_worst_case: bool = True
    """A board of the worst case knows it."""
    by_wifi: bool = False
    """An aPad sends it by Wi-Fi; else by sound."""


PLAIN = {
    Kind.PERMISSION: PlainCommand(1, Trigger.PERMISSION_HEARD, "it may surface"),
    Kind.RELEASE: PlainCommand(1, Trigger.CLEAR_TO_SINK, "it is clear to sink", by_wifi=True),
    Kind.PING: PlainCommand(1, Trigger.PING_HEARD, "send a short status"),
    Kind.HOVER: PlainCommand(1, Trigger.HOVER_ORDERED, "hold the present depth", in_worst_case=False),
    Kind.SINK: PlainCommand(2, Trigger.SINK_ORDERED, "sink, and stay down"),
    Kind.BACK_UP_LOG: PlainCommand(
        2, None, "send the log, as long as there is Wi-Fi", in_worst_case=False, by_wifi=True
    ),
}


def sealed(body: bytes) -> bytes:
    """`body` with its check."""
    return body + _CRC.pack(crc_hqx(body, 0xFFFF))


def unsealed(data: bytes) -> bytes | None:
    """The bytes before the check; None if the check is wrong."""
    body = data[:-2]
    return body if len(data) > 2 and crc_hqx(body, 0xFFFF) == _CRC.unpack(data[-2:])[0] else None
