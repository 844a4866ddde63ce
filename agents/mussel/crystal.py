"""By how much each aMussel's clock is off: no two crystals are alike."""

from __future__ import annotations

from _blake2 import blake2b
from struct import Struct

_KEY = Struct("<QQ").pack


def drift_of(seed: int, agent_id: int, bound_ppb: int) -> int:
    """One crystal's drift: uniform on the integers of [-bound_ppb, +bound_ppb], by a keyed hash of (seed, agent id)."""
    word = int.from_bytes(blake2b(_KEY(seed, agent_id), digest_size=8, person=b"crystal").digest(), "little")
    return (word * (2 * bound_ppb + 1) >> 64) - bound_ppb
