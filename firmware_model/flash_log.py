"""The log of samples: a ring of records in flash, which a reset does not touch.

The flash has pages. An erased page reads as zeros (as the flash of some microcontrollers does; so a file that nobody
wrote to is an erased flash), bytes are programmed once, and only a whole page is erased. Record `sequence` stands in
page `sequence // records a page`, modulo the pages, and entering a page erases what it held. The page that comes next
counts as gone already: so what a reset undoes has destroyed nothing that still counted.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from firmware_model.sample_record import RECORD_BYTES, SampleRecord

PAGES = 16
PAGE_BYTES = 4096
"""With 170 records a page, the log holds at least 2380: 99 days of a sample an hour."""


class Flash(Protocol):
    """Pages of `page_bytes`. Addresses are bytes from the region's begin."""

    pages: int
    page_bytes: int

    def read(self, at: int, size: int) -> bytes:
        """Zeros where nothing was programmed since the page was erased."""
        ...

    def program(self, at: int, data: bytes) -> None:
        """Onto erased bytes of one page."""
        ...

    def erase(self, page: int) -> None: ...


@dataclass(frozen=True, slots=True)
class Ring:
    """Where records lie in a flash of so many pages (3 or more)."""

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

    def first_in(self, flash: Flash, page: int) -> int | None:
        """The sequence of a page's first record; None when nothing of it can be read."""
        for n, slot in enumerate(self.written(flash, page)):
            if (record := SampleRecord.decode(slot)) is not None:
                return record.sequence - n
        return None

    def written(self, flash: Flash, page: int) -> list[bytes]:
        """The page's records as bytes, without those behind the last that is not blank."""
        data = flash.read(page * self.page_bytes, self.records_a_page * RECORD_BYTES)
        used = -(-len(data.rstrip(b"\0")) // RECORD_BYTES)
        return [data[n * RECORD_BYTES : (n + 1) * RECORD_BYTES] for n in range(used)]


class FlashLog:
    """The board's log. `torn` counts records of the newest page that a reset found begun and unreadable."""

    def __init__(self, flash: Flash, next_sequence: int, acknowledged: int) -> None:
        """Finds the newest record by scanning sequences and checks.

        `next_sequence` and `acknowledged` are what the clock chip's registers kept, so that no sequence is ever given
        twice: where the flash ends before `next_sequence`, what lies between was torn.
        """
        self._flash = flash
        self.ring = Ring(flash.pages, flash.page_bytes)
        self.acknowledged = acknowledged
        self.next_sequence = self.torn = 0
        self._recover(next_sequence)
        self.oldest = min(self.next_sequence, self.ring.oldest(self.next_sequence))
        """The sequence of the first record that the log still holds."""

    @property
    def overwritten(self) -> int:
        """How many records are gone that nobody has acknowledged."""
        return max(0, self.oldest - self.acknowledged)

    @property
    def waiting_from(self) -> int:
        """The first record that is to be uploaded."""
        return max(self.oldest, self.acknowledged)

    @property
    def waiting(self) -> int:
        """How many records are to be uploaded."""
        return self.next_sequence - self.waiting_from

    def append(self, record: SampleRecord) -> None:
        """Writes the record `next_sequence`; ValueError for another."""
        sequence, ring = self.next_sequence, self.ring
        if record.sequence != sequence:
            raise ValueError(f"record {sequence} comes next, not {record.sequence}")
        address = ring.address(sequence)
        if address % ring.page_bytes == 0:
            self._flash.erase(address // ring.page_bytes)
        self._flash.program(address, record.encode())
        self.next_sequence = sequence + 1
        self.oldest = ring.oldest(sequence + 1)

    def raw(self, first: int, until: int) -> bytes:
        """The records from `first` up to and without `until` that can be read, in order, as they stand in flash."""
        flash, address, found = self._flash, self.ring.address, []
        for sequence in range(max(first, self.oldest), min(until, self.next_sequence)):
            slot = flash.read(address(sequence), RECORD_BYTES)
            if SampleRecord.is_whole(slot, sequence):
                found.append(slot)
        return b"".join(found)

    def read(self, first: int, until: int) -> tuple[SampleRecord, ...]:
        """As `raw`, read."""
        data = self.raw(first, until)
        read = (SampleRecord.decode(data[at : at + RECORD_BYTES]) for at in range(0, len(data), RECORD_BYTES))
        return tuple([record for record in read if record is not None])

    def newest(self) -> SampleRecord | None:
        """The newest record, if it can be read."""
        found = self.read(self.next_sequence - 1, self.next_sequence)
        return found[0] if found else None

    def acknowledge(self, next_sequence: int) -> bool:
        """Everything below is kept elsewhere; False for what acknowledges nothing new, or more than there is."""
        if not self.acknowledged < next_sequence <= self.next_sequence:
            return False
        self.acknowledged = next_sequence
        return True

    def _recover(self, next_sequence: int) -> None:
        """Goes on behind the newest record that can be read, and behind what was torn after it."""
        firsts = [
            first
            for page in range(self.ring.pages)
            if (first := self.ring.first_in(self._flash, page)) is not None
        ]
        newest = max(firsts, default=0)
        slots = self.ring.written(self._flash, self.ring.page(newest)) if firsts else []
        end = newest + len(slots)
        known = max(end, next_sequence)
        begun = self._begun(known)
        # A page that was begun is erased before its first record is written: that sequence is free.
        self.next_sequence = known + (begun if known % self.ring.records_a_page else 0)
        unreadable = [SampleRecord.decode(slot) for slot in slots].count(None)
        self.torn = unreadable + known - end + begun

    def _begun(self, sequence: int) -> int:
        """How many records from `sequence` on cannot be written now, because something was begun there."""
        page, before = self.ring.page(sequence), sequence % self.ring.records_a_page
        first = self.ring.first_in(self._flash, page)
        if first is not None and first != sequence - before:
            return -before % self.ring.records_a_page  # the page was never erased for them
        return max(0, len(self.ring.written(self._flash, page)) - before)


class MemoryFlash:
    """A flash in this process's memory; it refuses what a real one does badly."""

    def __init__(self, pages: int = PAGES, page_bytes: int = PAGE_BYTES) -> None:
        self.pages = pages
        self.page_bytes = page_bytes
        self._pages: dict[int, bytearray] = {}

    def read(self, at: int, size: int) -> bytes:
        page, offset = divmod(at, self.page_bytes)
        return bytes(self._pages.get(page, bytearray(self.page_bytes))[offset : offset + size])

    def program(self, at: int, data: bytes) -> None:
        """ValueError over bytes that are not erased, or beyond a page."""
        page, offset = divmod(at, self.page_bytes)
        if offset + len(data) > self.page_bytes or page >= self.pages:
            raise ValueError("what is programmed lies in one page")
        if any(self.read(at, len(data))):
            raise ValueError("these bytes are not erased")
        self._pages.setdefault(page, bytearray(self.page_bytes))[offset : offset + len(data)] = data

    def erase(self, page: int) -> None:
        self._pages.pop(page, None)
