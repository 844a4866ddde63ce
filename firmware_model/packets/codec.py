"""Codecs from packets to bytes and back. The built-in one is ours; a laboratory's own comes by entry point."""

from __future__ import annotations

from typing import Protocol, cast

from firmware_model import packets

BUILT_IN = "musselbed-1"
GROUP = "musselbed.codecs"


class Codec(Protocol):
    """Turns packets into bytes and back. Every process of an aMussel has one, and so has the supervisor."""

    def encode(self, packet: packets.Packet) -> bytes:
        """The bytes of a packet; the same ones for the same packet."""

    def decode(self, data: bytes) -> packets.Packet | None:
        """The packet of these bytes; None for bytes that are not one whole packet. It never raises."""


class MusselbedCodec:
    """The layout of `firmware_model.packets`."""

    def encode(self, packet: packets.Packet) -> bytes:
        return packet.encode()

    def decode(self, data: bytes) -> packets.Packet | None:
        return packets.decode(data)


def load_codec(name: str) -> Codec:
    """The codec called `name`: the built-in one, or a class under the entry-point group `musselbed.codecs`.

    Raises ValueError for an unknown name, with the known names in its text.
    """
    if name == BUILT_IN:
        return MusselbedCodec()
    # Imported here: it takes megabytes that an agent with the built-in layout never needs.
    from importlib.metadata import entry_points

    found = {entry.name: entry for entry in entry_points(group=GROUP)}
    if name not in found:
        raise ValueError(f"no codec is called {name!r}; there are: {', '.join(sorted([BUILT_IN, *found]))}")
    return cast(Codec, found[name].load()())
