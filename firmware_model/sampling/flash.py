"""The flash memory of a log: its pages, the addresses of its records, and a flash in memory for boards without a file."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from firmware_model.packets.sample_record import RECORD_BYTES

PAGES = 16
PAGE_BYTES = 4096
"""With 170 records a page, the log holds at least 2380: 99 days of a sample an hour."""


class Flash(Protocol):
    """Pages of `page_bytes`. Addresses are bytes from the start of the region."""

    pages: int
    page_bytes: int

    def read(self, at: int, size: int) -> bytes:
        """Reads bytes; zeros if nothing was programmed since the page was erased."""

    def program(self, at: int, data: bytes) -> None:
        """Programs erased bytes of one page."""

    def erase(self, page: int) -> None: ...


@dataclass(frozen=True, slots=True)
class Ring:
    """The positions of records in a flash of 3 or more pages."""

    pages: int
    page_bytes: int

    @property
    def records_a_page(self) -> int:
        return self.page_bytes // RECORD_BYTES

    def page(self, sequence: int) -> int:
        return sequence // self.records_a_page % self.pages

    def address(self, sequence: int) -> int:
        page, place = divmod(sequence, self.page_bytes // RECORD_BYTES)
        return page % self.pages * self.page_bytes + place * RECORD_BYTES

    def oldest(self, next_sequence: int) -> int:
        """The first record that still counts when `next_sequence` is the next to be written."""
        a_page = self.page_bytes // RECORD_BYTES
        return max(0, (next_sequence // a_page - self.pages + 2) * a_page)


class MemoryFlash:
    """A flash in this process's memory; it refuses operations that corrupt a real one."""

    def __init__(self, pages: int = PAGES, page_bytes: int = PAGE_BYTES) -> None:
        self.pages = pages
        self.page_bytes = page_bytes
        self._pages: dict[int, bytearray] = {}

    def read(self, at: int, size: int) -> bytes:
        page, offset = divmod(at, self.page_bytes)
        return bytes(self._pages.get(page, bytearray(self.page_bytes))[offset : offset + size])

    def program(self, at: int, data: bytes) -> None:
        """Programs bytes; ValueError if they are not erased, or reach beyond a page."""
        page, offset = divmod(at, self.page_bytes)
        if offset + len(data) > self.page_bytes or page >= self.pages:
            raise ValueError("what is programmed lies in one page")
        if any(self.read(at, len(data))):
            raise ValueError("these bytes are not erased")
        self._pages.setdefault(page, bytearray(self.page_bytes))[offset : offset + len(data)] = data

    def erase(self, page: int) -> None:
        self._pages.pop(page, None)
