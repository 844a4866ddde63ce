"""Where new objects lie in memory: next to each other, when nothing before them has left a hole."""

from __future__ import annotations

import ctypes
import gc
import sys
from collections.abc import Callable
from types import CodeType, FrameType, FunctionType

_SMALL_BYTES = 512
"""CPython's own allocator serves up to this, from pools of one size each; malloc serves the rest."""
_POOL_BYTES = 16384
_FIRST_IN_POOL = 48
_FRESH = 8
"""So many objects in a row, from a pool's first place on, are in a pool that was empty."""
_LARGE_BYTES = 32768
_BYTES_HEAD = 33
_ROUNDS = 200_000
"""Far more objects than there are holes: an interpreter that lays out memory in another way must not hang here."""
_MERGEABLE = 12
"""MADV_MERGEABLE of madvise(2)."""
_LIBC = ctypes.CDLL(None)
_LIBC.sbrk.restype = ctypes.c_void_p


def return_freed_memory() -> None:
    """Gives malloc's free pages back to the system: forked processes would copy the ones they touch."""
    _LIBC.malloc_trim(0)


def offer_for_merging() -> None:
    """Tells the kernel that what this process and its children write to may be kept once where it is the same.

    Most of the pages that an agent copies are equal to another agent's, because reference counts went up and down alike. A
    kernel whose merging is off, or that has none, takes no notice: then nothing changes.
    """
    with open("/proc/self/maps") as maps:
        spans = [line.split()[0].split("-") for line in maps if " rw-p " in line and "[stack]" not in line]
    for begin, end in spans:
        _LIBC.madvise(
            ctypes.c_void_p(int(begin, 16)), ctypes.c_size_t(int(end, 16) - int(begin, 16)), _MERGEABLE
        )


def fill_holes() -> list[object]:
    """Objects that fill every hole that freed ones left: while they live, what is made next lies in pages of its own.

    For CPython 3.11's pools, where the first objects of an untouched pool tell that no hole of that size is left.
    """
    gc.collect()
    return_freed_memory()
    end = _LIBC.sbrk(0) or 0
    filling: list[object] = []
    for size in range(_LARGE_BYTES, _SMALL_BYTES, -16):
        _fill_large(filling, size, end)
    for size in range(_SMALL_BYTES, 32, -16):
        _fill_small(filling, size)
    return filling


def gather_code(play: Callable[[], None]) -> None:
    """Plays, and moves the code of the functions that ran next to each other.

    Calling a function writes to its code's reference count, so code that lies between what never runs costs a page each.
    Functions that the garbage collector was told to pass over stay where they are. What was specialised is forgotten.
    """
    ran: set[CodeType] = set()

    def note(frame: FrameType, event: str, _: object) -> None:
        if event == "call":
            ran.add(frame.f_code)

    sys.setprofile(note)
    try:
        play()
    finally:
        sys.setprofile(None)
    functions = [it for it in gc.get_objects() if type(it) is FunctionType and it.__code__ in ran]
    filling = fill_holes()
    for function in functions:
        function.__code__ = _moved(function.__code__, ran)
    del filling


def _moved(code: CodeType, ran: set[CodeType]) -> CodeType:
    """A copy, with copies of the code within it that ran too."""
    return code.replace(
        co_consts=tuple(
            _moved(it, ran) if isinstance(it, CodeType) and it in ran else it for it in code.co_consts
        )
    )


def _fill_large(filling: list[object], size: int, end: int) -> None:
    for _ in range(_ROUNDS):
        made = bytes(size - _BYTES_HEAD)
        if id(made) >= end:
            return
        filling.append(made)


def _fill_small(filling: list[object], size: int) -> None:
    in_a_row = 0
    for _ in range(_ROUNDS):
        made = bytes(size - _BYTES_HEAD)
        at = id(made) % _POOL_BYTES
        # One alone may lie in the first place of a pool where only that is free.
        in_a_row = in_a_row + 1 if at == _FIRST_IN_POOL + in_a_row * size else int(at == _FIRST_IN_POOL)
        if in_a_row == _FRESH:
            del filling[1 - _FRESH :]
            return
        filling.append(made)
