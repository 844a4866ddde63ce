"""The log of samples: a ring of records in flash, which a reset does not change.

The flash has pages. An erased page reads as zeros (as the flash of some microcontrollers does; so a file without writes is
an erased flash), bytes are programmed once, and only a whole page is erased. Record `sequence` lies in page `sequence //
records a page`, modulo the pages, and entering a page erases its old records. The page that comes next counts as erased
already: so a write that a reset undoes has destroyed no record that still counted.
"""

from __future__ import annotations

from firmware_model.packets.sample_record import RECORD_BYTES, SampleRecord
from firmware_model.sampling.flash import Flash, Ring, recovered


class FlashLog:
    """The board's log. `torn` counts the records of the newest page that were partly written when a reset came."""

    def __init__(self, flash: Flash, next_sequence: int, acknowledged: int) -> None:
        """Finds the newest record by scanning sequences and checks.

        `next_sequence` and `acknowledged` come from the clock chip's registers, so that no sequence is ever used twice: if
        the flash ends before `next_sequence`, the records between were torn.
        """
        self._flash = flash
        self.ring = Ring(flash.pages, flash.page_bytes)
        self.acknowledged = acknowledged
        self.next_sequence, self.torn = recovered(flash, self.ring, next_sequence)
        self.oldest = min(self.next_sequence, self.ring.oldest(self.next_sequence))
        """The sequence of the first record that the log still holds."""

    @property
    def overwritten(self) -> int:
        """The number of records that were overwritten without an acknowledgement."""
        return max(0, self.oldest - self.acknowledged)

    @property
    def waiting_from(self) -> int:
        """The first record that is to be uploaded."""
        return max(self.oldest, self.acknowledged)

    @property
    def waiting(self) -> int:
        """The number of records to be uploaded."""
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
        """The readable records from `first` up to and without `until`, in order, as their bytes in flash."""
        flash, address, found = self._flash, self.ring.address, []
        for sequence in range(max(first, self.oldest), min(until, self.next_sequence)):
            data = flash.read(address(sequence), RECORD_BYTES)
            if SampleRecord.is_whole(data, sequence):
                found.append(data)
        return b"".join(found)

    def read(self, first: int, until: int) -> tuple[SampleRecord, ...]:
        """The records of `raw`, decoded."""
        data = self.raw(first, until)
        read = (SampleRecord.decode(data[at : at + RECORD_BYTES]) for at in range(0, len(data), RECORD_BYTES))
        return tuple([record for record in read if record is not None])

    def newest(self) -> SampleRecord | None:
        """The newest record, if it can be read."""
        found = self.read(self.next_sequence - 1, self.next_sequence)
        return found[0] if found else None

    def acknowledge(self, next_sequence: int) -> bool:
        """Marks all records below as stored elsewhere; False if that is nothing new, or more than there is."""
        if not self.acknowledged < next_sequence <= self.next_sequence:
            return False
        self.acknowledged = next_sequence
        return True
