"""Docking misses by a keyed hash of (seed, agent, attempt), so that every stack misses the same dockings."""

from __future__ import annotations

from collections import Counter
from hashlib import blake2b
from struct import Struct

_KEY = Struct("<QQQ").pack
_HASH_VALUES = 2**64
MISSED = "the docking mechanism missed the aMussel"


class Misses:
    """Each attempt misses with `probability` in [0, 1], independently between agents and between attempts."""

    def __init__(self, seed: int, probability: float) -> None:
        self._seed = seed
        self._threshold = round(probability * _HASH_VALUES)
        self._attempts: Counter[int] = Counter()

    def misses(self, agent_id: int) -> bool:
        """Counts the agent's next attempt; True when it misses."""
        self._attempts[agent_id] += 1
        digest = blake2b(
            _KEY(self._seed, agent_id, self._attempts[agent_id]), digest_size=8, person=b"dock miss"
        )
        return int.from_bytes(digest.digest(), "little") < self._threshold
