"""Docking misses by a keyed hash of (seed, agent, attempt), so that every stack misses the same dockings.

A flow makes misses likelier: the thrust that holding takes is not there to correct the place. Of the dockings that succeed
in calm water, the share that misses in a flow is the share of the thrust that holding takes. So an aPad that cannot hold
its place docks nothing. The form is our choice: we know no published dockings of such a vehicle in a current.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from hashlib import blake2b
from struct import Struct

_KEY = Struct("<QQQ").pack
_HASH_VALUES = 2**64
MISSED = "the docking mechanism missed the aMussel"
Place = tuple[float, float]
Effort = Callable[[Place, int], float]
"""The part of the thrust, in [0, 1], that holding takes at a place (north, east) in metres and a mission time in ms."""


class Misses:
    """Each attempt misses with `probability` in [0, 1], independently between agents and between attempts.

    With an `effort` e the probability is p + (1 - p) e.
    """

    def __init__(self, seed: int, probability: float, effort: Effort | None = None) -> None:
        self._seed = seed
        self._probability = probability
        self._effort = effort
        self._attempts: Counter[int] = Counter()

    def misses(self, agent_id: int, place_m: Place = (0.0, 0.0), at_ms: int = 0) -> bool:
        """Counts the agent's next attempt, of an aPad at that place and time; True when it misses."""
        probability = self._probability
        if self._effort is not None:
            probability += (1 - probability) * self._effort(place_m, at_ms)
        self._attempts[agent_id] += 1
        digest = blake2b(
            _KEY(self._seed, agent_id, self._attempts[agent_id]), digest_size=8, person=b"dock miss"
        )
        return int.from_bytes(digest.digest(), "little") < round(probability * _HASH_VALUES)
