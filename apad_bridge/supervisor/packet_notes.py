"""An acoustic packet as an event of the journal: sender, content, timeslot, and the outcome at each receiver."""

from __future__ import annotations

from agents.water.medium import PacketEnded, Reception
from apad_bridge.events.sound import HeardRow, PacketPassed
from firmware_model.config import Timeslots


def packet_event(packet: PacketEnded, timeslots: Timeslots | None, speed_m_s: float) -> PacketPassed:
    """`speed_m_s` is that of sound. This flight's aPad is 0, and another one -n, the n-th."""
    frame = packet.frame
    return PacketPassed(
        from_=packet.sender,
        address=frame.destination,
        what=frame.kind.name.lower(),
        bytes=len(frame.data),
        began_ms=packet.began_ms,
        lasted_ms=frame.duration_ms,
        timeslot=None if timeslots is None else packet.began_ms % timeslots.frame_ms // timeslots.slot_ms,
        unsent=packet.unsent,
        heard=[_row(reception, speed_m_s) for reception in packet.receptions],
        data_=frame.data.hex(),
    )


def _row(reception: Reception, speed_m_s: float) -> HeardRow:
    return (
        reception.receiver,
        reception.outcome.name.lower(),
        round(reception.snr_db, 1),
        reception.at_ms,
        round(reception.travelled_us / 1000, 3),
        round(reception.travelled_us * speed_m_s / 1e6, 2),
    )
