"""The flash memory of a log: its pages, the addresses of its records, and a flash in memory for boards without a file."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from firmware_model.packets.sample_record import RECORD_BYTES, SampleRecord

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


# Finds the end of a log in flash after a reset, by scanning sequences and checks.
#
# It is a module of its own because it runs once, before an agent's process is forked.
def recovered(flash: Flash, ring: Ring, next_sequence: int) -> tuple[int, int]:
    """The next sequence, and the number of records in the newest page that are partly written and unreadable.

    `next_sequence` comes from the registers: if the flash ends before it, the records between were torn.
    """
    firsts = [first for page in range(ring.pages) if (first := first_in(flash, ring, page)) is not None]
    newest = max(firsts, default=0)
    raw_records = _written(flash, ring, ring.page(newest)) if firsts else []
    end = newest + len(raw_records)
    known = max(end, next_sequence)
    unwritable = _unwritable(flash, ring, known)
    unreadable = [SampleRecord.decode(raw_record) for raw_record in raw_records].count(None)
    return known + unwritable, unreadable + known - end + unwritable


def first_in(flash: Flash, ring: Ring, page: int) -> int | None:
    """The sequence of a page's first record; None if no record of the page can be read."""
    for n, raw_record in enumerate(_written(flash, ring, page)):
        if (record := SampleRecord.decode(raw_record)) is not None:
            return record.sequence - n
    return None


def _unwritable(flash: Flash, ring: Ring, sequence: int) -> int:
    """The number of records from `sequence` on that cannot be written, because their bytes are not erased."""
    page, before = ring.page(sequence), sequence % ring.records_a_page
    if (first := first_in(flash, ring, page)) is not None and first != sequence - before:
        return -before % ring.records_a_page  # the page was never erased for them
    used = len(_written(flash, ring, page)) - before
    # Several unreadable records and no whole one before them are of the ring's former round: the page is erased as usual.
    return 0 if before == 0 and used > 1 else max(0, used)


def _written(flash: Flash, ring: Ring, page: int) -> list[bytes]:
    """The page's records as bytes, up to the last record that is not blank."""
    data = flash.read(page * ring.page_bytes, ring.records_a_page * RECORD_BYTES)
    used = -(-len(data.rstrip(b"\0")) // RECORD_BYTES)
    return [data[n * RECORD_BYTES : (n + 1) * RECORD_BYTES] for n in range(used)]
