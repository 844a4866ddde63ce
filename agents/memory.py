"""Where new objects lie in memory: next to each other, when nothing before them has left a hole."""

from __future__ import annotations

import ctypes
import gc
from collections.abc import Callable

_SMALL_BYTES = 512
"""CPython's own allocator serves up to this, from pools of one size each; malloc serves the rest."""
_POOL_BYTES = 16384
_FIRST_IN_POOL = 48
_LARGE_BYTES = 32768
_BYTES_HEAD = 33
_ROUNDS = 200_000
"""Far more objects than there are holes: an interpreter that lays out memory in another way must not hang here."""
_LIBC = ctypes.CDLL(None)
_LIBC.sbrk.restype = ctypes.c_void_p


def return_freed_memory() -> None:
    """Gives malloc's free pages back to the system: forked processes would copy the ones they touch."""
    _LIBC.malloc_trim(0)


def fill_holes() -> list[object]:
    """Objects that fill every hole that freed ones left: while they live, what is made next lies in pages of its own.

    For CPython 3.11's pools, where the first object of an untouched pool tells that no hole of that size is left.
    """
    gc.collect()
    return_freed_memory()
    end = _LIBC.sbrk(0) or 0
    filling: list[object] = []
    for size in range(_LARGE_BYTES, _SMALL_BYTES, -16):
        _fill(filling, size, lambda at: at >= end)
    for size in range(_SMALL_BYTES, 32, -16):
        _fill(filling, size, lambda at: at % _POOL_BYTES == _FIRST_IN_POOL)
    return filling


def _fill(filling: list[object], size: int, past_holes: Callable[[int], bool]) -> None:
    for _ in range(_ROUNDS):
        made = bytes(size - _BYTES_HEAD)
        if past_holes(id(made)):
            return
        filling.append(made)
