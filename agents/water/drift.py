"""The paper's drift: a uniform random step to north and to east, one each mission second (section V-A).

A step is a keyed hash of (seed, agent id, number of the step), in integer micrometres: it is the same whoever asks, in
whatever order, and a sum of steps is the same however time was cut.
"""

from __future__ import annotations

from _blake2 import blake2b
from struct import Struct

_KEY = Struct("<QQQ").pack
_WORDS = Struct("<QQ").unpack


def drift_step_um(seed: int, agent_id: int, n: int, amplitude_um: int) -> tuple[int, int]:
    """Step `n` of an agent, (north, east): independent, uniform on the integers of [-amplitude_um, +amplitude_um].

    All four are integers from 0 to 2^64 - 1. A 64-bit word is scaled to the range, which makes no value likelier than
    another by more than one part in 2^64 / (2 amplitude_um + 1).
    """
    width = 2 * amplitude_um + 1
    north, east = _WORDS(blake2b(_KEY(seed, agent_id, n), digest_size=16).digest())
    return (north * width >> 64) - amplitude_um, (east * width >> 64) - amplitude_um
