"""The built-in wire layout: all packets, and the one place that decodes bytes of any kind.

The swarm's own layout is not public; a laboratory's replaces this one through `firmware_model.packets.codec`.
docs/packets.md shows each packet's bytes.
"""

from __future__ import annotations

from collections.abc import Callable

from firmware_model.packets import command_packets
from firmware_model.packets.command_packets import Command
from firmware_model.packets.log_packets import LogRecords
from firmware_model.packets.status_packets import (
    AcousticStatus,
    ShortStatus,
    StatusPacket,
    WifiStatus,
)
from firmware_model.packets.wire import PLAIN, unsealed

Packet = StatusPacket | ShortStatus | LogRecords | Command

_BY_HEAD: dict[tuple[int, int], Callable[[bytes], Packet | None]] = {
    **{
        (kind.VERSION, kind.KIND): kind.decode_body
        for kind in (StatusPacket, AcousticStatus, WifiStatus, LogRecords)
    },
    **{(it.VERSION, it.kind): it.decode_body for it in command_packets.WITH_ARGUMENTS},
    **{(it.version, kind): command_packets.decode_plain for kind, it in PLAIN.items()},
}
"""The decoders, by version and kind."""


def decode(data: bytes) -> Packet | None:
    """The packet, or None for bytes that are not a complete, undamaged packet of a known version."""
    body = unsealed(data)
    if body is None or len(body) < 2:
        return None
    read = _BY_HEAD.get((body[0], body[1]))
    return ShortStatus.decode_body(body) if read is None else read(body)
