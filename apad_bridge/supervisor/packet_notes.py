"""An acoustic packet as plain data for the journal: sender, content, timeslot, and the outcome at each receiver."""

from __future__ import annotations

from typing import Any

from agents.water.medium import PacketEnded, Reception
from firmware_model.config import Timeslots


def packet_data(packet: PacketEnded, timeslots: Timeslots | None, speed_m_s: float) -> dict[str, Any]:
    """Plain data. `began_ms` and the receptions' ends are agent time; `timeslot` is the timeslot in which it began.

    `heard` has a row for each receiver: id, outcome, SNR in dB, end, travel time in ms, travel distance in m. This flight's
    aPad is 0, and another one -n, the n-th.
    """
    frame = packet.frame
    return {
        "from": packet.sender,
        "address": frame.destination,
        "what": frame.kind.name.lower(),
        "bytes": len(frame.data),
        "began_ms": packet.began_ms,
        "lasted_ms": frame.duration_ms,
        "timeslot": None if timeslots is None else packet.began_ms % timeslots.frame_ms // timeslots.slot_ms,
        "unsent": packet.unsent,
        "heard": [_row(reception, speed_m_s) for reception in packet.receptions],
        "data": frame.data.hex(),
    }


def _row(reception: Reception, speed_m_s: float) -> list[Any]:
    return [
        reception.receiver,
        reception.outcome.name.lower(),
        round(reception.snr_db, 1),
        reception.at_ms,
        round(reception.travelled_us / 1000, 3),
        round(reception.travelled_us * speed_m_s / 1e6, 2),
    ]
