"""The share of packets that are lost, by range, over sound and over Wi-Fi."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from math import dist

import numpy as np

from apad_bridge.field.calibration.intervals import Figure, share
from apad_bridge.field.field_log.log_facts import LoggedFact, PacketLogged, SoundEnded
from apad_bridge.field.field_log.vehicle_log import Track
from firmware_model.packets import StatusPacket
from firmware_model.packets.codec import Codec
from firmware_model.state_groups import UP_AND_UNDOCKED

EDGES_M = (0.0, 10.0, 20.0, 50.0, 100.0, 200.0, 500.0, 1000.0, 2000.0)
_LONGEST_SILENCE = 10
"""Reports in a row: who is silent for longer may have sunk."""


@dataclass(frozen=True, slots=True)
class Loss:
    """Lost packets among those sent, with a range in [from, to) metres."""

    from_m: float
    to_m: float | None
    lost: Figure


def by_range(packets: Iterable[tuple[float, bool]]) -> list[Loss]:
    """`packets` are (range in m, lost)."""
    sent = [0] * len(EDGES_M)
    lost = [0] * len(EDGES_M)
    for range_m, is_lost in packets:
        place = max(0, bisect_right(EDGES_M, range_m) - 1)
        sent[place] += 1
        lost[place] += is_lost
    ends: list[float | None] = [*EDGES_M[1:], None]
    return [
        Loss(EDGES_M[n], ends[n], figure) for n in range(len(EDGES_M)) if (figure := share(lost[n], sent[n]))
    ]


def of_sound(sounds: Iterable[SoundEnded]) -> Iterator[tuple[float, bool]]:
    return ((it.range_m, not it.is_received) for it in sounds)


def of_wifi(
    facts: Iterable[LoggedFact], track: Track, codec: Codec, period_s: float
) -> Iterator[tuple[float, bool]]:
    """Reports of floating aMussels, which send one each `period_s`: a longer gap between two has lost those that were due.

    A gap of more than ten reports counts for nothing. The range is that at the report after the gap.
    """
    last_s: dict[int, float] = {}
    for fact in facts:
        if not isinstance(fact, PacketLogged) or fact.medium != "wifi":
            continue
        status = codec.decode(fact.data)
        if not isinstance(status, StatusPacket) or not len(track):
            continue
        before_s = last_s.pop(fact.agent_id, None)
        if status.state not in UP_AND_UNDOCKED:
            continue
        last_s[fact.agent_id] = fact.at_s
        due = 0 if before_s is None else round((fact.at_s - before_s) / period_s)
        if not 1 <= due <= _LONGEST_SILENCE:
            continue
        here_m = [float(np.interp(fact.at_s, track.times_s, it)) for it in (track.north_m, track.east_m)]
        range_m = dist(here_m, (status.north_m, status.east_m))
        yield range_m, False
        for _ in range(due - 1):
            yield range_m, True
