"""Codecs from packets to bytes and back. The built-in one is ours; a laboratory's own comes by entry point."""

from __future__ import annotations

from typing import Protocol, cast

from firmware_model import packets
from firmware_model.entry_points import entry_points, in_one_line

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


class _Checked:
    """A package's codec, whose name stands in the error for what is no bytes: it would end far from its cause."""

    def __init__(self, codec: Codec, name: str) -> None:
        self._codec = codec
        self._name = name
        self.decode = codec.decode

    def encode(self, packet: packets.Packet) -> bytes:
        data = self._codec.encode(packet)
        if not isinstance(data, bytes):
            raise TypeError(f"{self._name} made {type(data).__name__} of a packet, and no bytes")
        return data


def load_codec(name: str) -> Codec:
    """The codec called `name`: the built-in one, or a class under the entry-point group `musselbed.codecs`.

    Raises ValueError for an unknown name, with the known names in its text, for a name that two packages bring, and for a
    class that cannot be made. The text then names the package with its version.
    """
    if name == BUILT_IN:
        return MusselbedCodec()
    entries = entry_points(GROUP)
    if not (found := [entry for entry in entries if entry.name == name]):
        known = ", ".join(sorted({BUILT_IN, *(entry.name for entry in entries)}))
        raise ValueError(f"no codec is called {name!r}; there are: {known}")
    packages = sorted({entry.brought_by for entry in found})
    if len(packages) > 1:
        raise ValueError(f"codec {name!r} is in each of {', '.join(packages)}: uninstall one of them")
    try:
        return _Checked(cast(Codec, found[0].load()()), f"codec {name!r} (from {packages[0]})")
    except Exception as error:
        raise ValueError(
            f"codec {name!r} (from {packages[0]}, {found[0].module}) cannot be loaded: {in_one_line(error)}"
        ) from error
