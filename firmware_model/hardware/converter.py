"""A converter whose readings scatter: a defect that few boards have."""

from __future__ import annotations

from struct import Struct

from firmware_model.keyed_hash import blake2b
from firmware_model.power.charge import FULL

_KEY = Struct("<QQB").pack


def scattered(readings: tuple[int, int], noise: int, agent_id: int, now_ms: int) -> tuple[int, int]:
    """Both batteries' readings, off by up to `noise` grains but within a battery: a keyed hash of (id, second, channel)."""
    primary, secondary = (
        max(0, min(FULL, reading + _off(noise, agent_id, now_ms, channel)))
        for channel, reading in enumerate(readings)
    )
    return primary, secondary


def _off(noise: int, agent_id: int, now_ms: int, channel: int) -> int:
    word = int.from_bytes(blake2b(_KEY(agent_id, now_ms // 1000, channel), digest_size=8).digest(), "little")
    return (word * (2 * noise + 1) >> 64) - noise
