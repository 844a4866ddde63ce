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
        return self.page(sequence) * self.page_bytes + sequence % self.records_a_page * RECORD_BYTES

    def oldest(self, next_sequence: int) -> int:
        """The first record that still counts when `next_sequence` is the next to be written."""
        begun = next_sequence // self.records_a_page
        return max(0, (begun - self.pages + 2) * self.records_a_page)


@dataclass(frozen=True, slots=True, order=True)
class _Page:
    """A page as found by scanning: its first record's sequence, how many were written, how many of those are unreadable."""

    first: int
    written: int
    torn: int


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
        self._recover(next_sequence)

    @property
    def oldest(self) -> int:
        """The sequence of the first record that the log still holds."""
        return min(self.next_sequence, self.ring.oldest(self.next_sequence))

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
        sequence = self.next_sequence
        if record.sequence != sequence:
            raise ValueError(f"record {sequence} comes next, not {record.sequence}")
        if sequence % self.ring.records_a_page == 0:
            self._flash.erase(self.ring.page(sequence))
        self._flash.program(self.ring.address(sequence), record.encode())
        self.next_sequence += 1

    def read(self, first: int, until: int) -> tuple[SampleRecord, ...]:
        """The records from `first` up to and without `until` that can be read, in order."""
        found = []
        for sequence in range(max(first, self.oldest), min(until, self.next_sequence)):
            record = SampleRecord.decode(self._flash.read(self.ring.address(sequence), RECORD_BYTES))
            if record is not None and record.sequence == sequence:
                found.append(record)
        return tuple(found)

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
        newest = max(filter(None, map(self._scan, range(self.ring.pages))), default=_Page(0, 0, 0))
        end, torn = newest.first + newest.written, newest.torn
        if newest.written == self.ring.records_a_page:
            begun = self._torn_at_begin(self.ring.page(end))
            end, torn = end + begun, torn + begun
        self.next_sequence = max(end, next_sequence)
        self.torn = torn + self.next_sequence - end

    def _scan(self, page: int) -> _Page | None:
        """What a page holds; None for nothing that can be read."""
        slots = self._slots(page)
        records = [SampleRecord.decode(slot) for slot in slots]
        for n, record in enumerate(records):
            if record is not None:
                return _Page(record.sequence - n, len(slots), records.count(None))
        return None

    def _torn_at_begin(self, page: int) -> int:
        """How many records were begun in a page where none can be read."""
        return len(self._slots(page)) if self._scan(page) is None else 0

    def _slots(self, page: int) -> list[bytes]:
        """The page's records as bytes, without those behind the last that is not blank."""
        data = self._flash.read(page * self.ring.page_bytes, self.ring.records_a_page * RECORD_BYTES)
        used = -(-len(data.rstrip(b"\0")) // RECORD_BYTES)
        return [data[n * RECORD_BYTES : (n + 1) * RECORD_BYTES] for n in range(used)]
