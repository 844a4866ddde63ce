"""How packets become bytes. The built-in layout is ours; a laboratory's own comes from its package by entry point."""

from __future__ import annotations

from typing import Protocol, cast

from firmware_model import packets

BUILT_IN = "musselbed-1"
GROUP = "musselbed.codecs"


class Codec(Protocol):
    """Bytes out for a packet; a packet, or None for bytes that are not one. `decode` never raises on bad bytes."""

    def encode(self, packet: packets.Packet) -> bytes: ...

    def decode(self, data: bytes) -> packets.Packet | None: ...


class MusselbedCodec:
    """The layout of `firmware_model.packets`."""

    def encode(self, packet: packets.Packet) -> bytes:
        return packet.encode()

    def decode(self, data: bytes) -> packets.Packet | None:
        return packets.decode(data)


def load_codec(name: str) -> Codec:
    """The codec called `name`: built in, or a class under the entry-point group `musselbed.codecs`.

    Raises ValueError that names what there is when nothing is called so.
    """
    if name == BUILT_IN:
        return MusselbedCodec()
    # Imported here because it brings megabytes that an agent with the built-in layout never needs.
    from importlib.metadata import entry_points

    found = {entry.name: entry for entry in entry_points(group=GROUP)}
    if name not in found:
        raise ValueError(f"no codec is called {name!r}; there are: {', '.join(sorted([BUILT_IN, *found]))}")
    return cast(Codec, found[name].load()())
