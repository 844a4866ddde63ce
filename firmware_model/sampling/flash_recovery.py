"""What a reset finds of a log in flash: its end, by scanning sequences and checks.

It is apart from the log itself because it runs once, before an agent's process is forked.
"""

from __future__ import annotations

from firmware_model.packets.sample_record import RECORD_BYTES, SampleRecord
from firmware_model.sampling.flash import Flash, Ring


def recovered(flash: Flash, ring: Ring, next_sequence: int) -> tuple[int, int]:
    """The sequence that comes next, and how many records were found begun and unreadable in the newest page.

    `next_sequence` is what the registers kept: where the flash ends before it, what lies between was torn.
    """
    firsts = [first for page in range(ring.pages) if (first := first_in(flash, ring, page)) is not None]
    newest = max(firsts, default=0)
    slots = _written(flash, ring, ring.page(newest)) if firsts else []
    end = newest + len(slots)
    known = max(end, next_sequence)
    begun = _begun(flash, ring, known)
    unreadable = [SampleRecord.decode(slot) for slot in slots].count(None)
    # A page that was begun is erased before its first record is written: that sequence is free.
    used = begun if known % ring.records_a_page else 0
    return known + used, unreadable + known - end + begun


def first_in(flash: Flash, ring: Ring, page: int) -> int | None:
    """The sequence of a page's first record; None when nothing of it can be read."""
    for n, slot in enumerate(_written(flash, ring, page)):
        if (record := SampleRecord.decode(slot)) is not None:
            return record.sequence - n
    return None


def _begun(flash: Flash, ring: Ring, sequence: int) -> int:
    """How many records from `sequence` on cannot be written now, because something was begun there."""
    page, before = ring.page(sequence), sequence % ring.records_a_page
    first = first_in(flash, ring, page)
    if first is not None and first != sequence - before:
        return -before % ring.records_a_page  # the page was never erased for them
    return max(0, len(_written(flash, ring, page)) - before)


def _written(flash: Flash, ring: Ring, page: int) -> list[bytes]:
    """The page's records as bytes, without those behind the last that is not blank."""
    data = flash.read(page * ring.page_bytes, ring.records_a_page * RECORD_BYTES)
    used = -(-len(data.rstrip(b"\0")) // RECORD_BYTES)
    return [data[n * RECORD_BYTES : (n + 1) * RECORD_BYTES] for n in range(used)]
