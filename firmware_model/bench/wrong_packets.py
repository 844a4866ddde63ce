"""Packets that no board may obey: commands with a changed bit, and layouts that do not exist."""

from __future__ import annotations

from firmware_model.packets import (
    Beacon,
    Command,
    CommandPacket,
    HoverAt,
    Kind,
    LogAck,
    SetThreshold,
    SleepSchedule,
    SlotAssignment,
    Threshold,
)
from firmware_model.packets.wire import PLAIN, sealed


def damages(packet: bytes) -> list[bytes]:
    """The packet with one bit changed, for each of its bits."""
    return [
        bytes(byte ^ (1 << n % 8 if at == n // 8 else 0) for at, byte in enumerate(packet))
        for n in range(8 * len(packet))
    ]


EVERY_COMMAND: tuple[Command, ...] = (
    *(CommandPacket(kind, 1) for kind in PLAIN),
    HoverAt(1, 1.25),
    SleepSchedule(1, 60_000, 10_000),
    SlotAssignment(1, 300_000, 3000, 500, 7, 0),
    SetThreshold(1, Threshold.SAFE_LEVEL, 0.5),
    Beacon(1, 3_595_000),
    LogAck(1, 1),
)
"""One of each layout, for aMussel 1."""
_LAYOUTS = {(it[0], it[1], len(it)) for it in (command.encode() for command in EVERY_COMMAND)}
UNKNOWN_LAYOUTS = [
    sealed(bytes([version, kind, 1, 0]) + bytes(size - 6))
    for version in range(4)
    for kind in range(len(Kind) + 1)
    for size in sorted({size for _, _, size in _LAYOUTS})
    if (version, kind, size) not in _LAYOUTS
]
"""Packets for aMussel 1 with the right check, whose version, kind and size do not belong together."""
OTHER_VERSIONS = [sealed(b"\x09" + it.encode()[1:-2]) for it in EVERY_COMMAND]
"""Each command in another version."""


def by_sound(packets: list[bytes]) -> str:
    """The words of a script for these packets."""
    return " ".join(f"sound:{it.hex()}" for it in packets)
