"""Rows of the bag for an acoustic packet: its sender, its bytes, and its outcome at each listener."""

from __future__ import annotations

from typing import NamedTuple

from agents.modem.frames import TO_ALL
from agents.water.medium import PacketOutcome
from apad_bridge.events.sound_events import PacketPassed

_TO_ALL = frozenset(kind.name.lower() for kind in TO_ALL)


EVERYBODY = -1
"""The receiver of a broadcast, in a `SoundRow`."""
_TO_AN_APAD = 0
"""The receiver of a packet to the address that all aPads share."""
_CONFLICTS = frozenset(it.name.lower() for it in (PacketOutcome.COLLIDED, PacketOutcome.TRANSMITTING))


class SoundRow(NamedTuple):
    """One packet at one listener, with the fields of underwater_msgs/MediumTransmission; nodes are ids, 0 is the aPad.

    Of several aPads in one water, the n-th is the listener -n where it is not this flight's own.
    `message` is the outcome and then the bytes in hexadecimal; `conflict` is True when it collided or the listener was
    transmitting.
    """

    message: str
    duration_s: float
    sender: int
    receiver: int
    snr_db: float
    range_m: float
    listener: int
    conflict: bool


def sound_rows(packet: PacketPassed) -> list[SoundRow]:
    """A row for each listener of a packet; no rows for a packet that was never sent."""
    everybody = packet.what in _TO_ALL
    return [
        SoundRow(
            message=f"{outcome} {packet.data_}".rstrip(),
            duration_s=packet.lasted_ms / 1000,
            sender=packet.from_,
            receiver=EVERYBODY if everybody else max(listener, _TO_AN_APAD),
            snr_db=snr_db,
            range_m=range_m,
            listener=listener,
            conflict=outcome in _CONFLICTS,
        )
        for listener, outcome, snr_db, _, _, range_m in packet.heard
    ]
