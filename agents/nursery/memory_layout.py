"""Reduces the memory that forked agents copy, and lets the kernel share equal pages."""

from __future__ import annotations

import ctypes

_MERGEABLE = 12
"""MADV_MERGEABLE of madvise(2)."""
_LIBC = ctypes.CDLL(None)


def return_freed_memory() -> None:
    """Returns malloc's free pages to the system. A forked process would copy those that it touches."""
    _LIBC.malloc_trim(0)


def offer_for_merging() -> None:
    """Lets the kernel keep equal pages once, those of this process and of its children.

    Most of the pages that an agent copies equal another agent's, because reference counts rose and fell alike. A kernel
    without merging, or with merging switched off, ignores the call.
    """
    with open("/proc/self/maps") as maps:
        spans = [line.split()[0].split("-") for line in maps if " rw-p " in line and "[stack]" not in line]
    for begin, end in spans:
        _LIBC.madvise(
            ctypes.c_void_p(int(begin, 16)), ctypes.c_size_t(int(end, 16) - int(begin, 16)), _MERGEABLE
        )
