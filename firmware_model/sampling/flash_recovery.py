"""Finds the end of a log in flash after a reset, by scanning sequences and checks.

It is a module of its own because it runs once, before an agent's process is forked.
"""

from __future__ import annotations

from firmware_model.packets.sample_record import RECORD_BYTES, SampleRecord
from firmware_model.sampling.flash import Flash, Ring


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
    first = first_in(flash, ring, page)
    if first is not None and first != sequence - before:
        return -before % ring.records_a_page  # the page was never erased for them
    used = len(_written(flash, ring, page)) - before
    # Several unreadable records and no whole one before them are of the ring's former round: the page is erased as usual.
    return 0 if before == 0 and used > 1 else max(0, used)


def _written(flash: Flash, ring: Ring, page: int) -> list[bytes]:
    """The page's records as bytes, up to the last record that is not blank."""
    data = flash.read(page * ring.page_bytes, ring.records_a_page * RECORD_BYTES)
    used = -(-len(data.rstrip(b"\0")) // RECORD_BYTES)
    return [data[n * RECORD_BYTES : (n + 1) * RECORD_BYTES] for n in range(used)]
