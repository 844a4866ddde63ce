"""The fleet's flash file: a region for each agent, which the nursery opens once and agents inherit open.

Agents read and write it in place and never map it, because a mapped page would count as an agent's memory. Unwritten parts
read as zeros and take no room on the disk.
"""

from __future__ import annotations

import os

from firmware_model.sampling.flash import PAGE_BYTES, PAGES, Ring, first_in

FLASH_NAME = "samples.flash"


class FlashRegion:
    """One agent's flash, in the file open as `fd`: the region at `index`."""

    def __init__(self, fd: int, index: int, pages: int = PAGES, page_bytes: int = PAGE_BYTES) -> None:
        self._fd = fd
        self._offset = index * pages * page_bytes
        self.pages = pages
        self.page_bytes = page_bytes

    def read(self, at: int, size: int) -> bytes:
        return os.pread(self._fd, size, self._offset + at).ljust(size, b"\0")

    def program(self, at: int, data: bytes) -> None:
        os.pwrite(self._fd, data, self._offset + at)

    def erase(self, page: int) -> None:
        self.program(page * self.page_bytes, bytes(self.page_bytes))

    def roll_back(self, next_sequence: int) -> None:
        """Erases the records from `next_sequence` on: those of an unanswered window did not happen."""
        ring = Ring(self.pages, self.page_bytes)
        at = ring.address(next_sequence)
        rest = bytes(self.page_bytes - at % self.page_bytes)
        if self.read(at, len(rest)) != rest:
            self.program(at, rest)
        for page in range(self.pages):
            if (first := first_in(self, ring, page)) is not None and first >= next_sequence:
                self.erase(page)
