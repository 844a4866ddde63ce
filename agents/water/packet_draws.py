"""Random numbers for packets in the water: a keyed hash of (seed, sender, time of the packet's begin, receiver).

The probability with which they are compared is that of `sound.py`, `wifi.py` and `topology.py`.

The numbers are the same whoever asks, in whatever order, and however often. A run that goes on after a crash draws no
number twice, because a sender begins no two packets at the same time.
"""

from __future__ import annotations

from math import cos, log, pi, sqrt
from struct import Struct

from firmware_model.keyed_hash import blake2b

_KEY = Struct("<Qqqq").pack
_WORDS = Struct("<QQQQ").unpack
_UNIT = 2.0**-64


def fates(seed: int, sender: int, began_ms: int, receiver: int, lane: bytes) -> tuple[float, float, float]:
    """(uniform, uniform, standard normal), independent; uniforms lie in [0, 1). `lane` separates kinds of packets."""
    digest = blake2b(_KEY(seed, sender, began_ms, receiver), digest_size=32, person=lane).digest()
    first, second, third, fourth = _WORDS(digest)
    normal = sqrt(-2 * log((third + 1) * _UNIT)) * cos(2 * pi * fourth * _UNIT)
    return min(first * _UNIT, 1 - 2.0**-53), min(second * _UNIT, 1 - 2.0**-53), normal
