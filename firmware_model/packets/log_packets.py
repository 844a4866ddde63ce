"""The packet that carries records of the log to an aPad."""

from __future__ import annotations

import struct
from collections.abc import Iterable
from dataclasses import dataclass
from typing import ClassVar

from firmware_model.packets.sample_record import RECORD_BYTES, SampleRecord
from firmware_model.packets.wire import Kind, sealed

_BEFORE = struct.Struct("<BBHIIB")
RECORDS_AT_ONCE = min(18, (511 - _BEFORE.size - 2) // RECORD_BYTES)
"""Records in one packet, which keeps it below 512 bytes: beyond that an agent's process uses another memory allocator."""


@dataclass(frozen=True, slots=True)
class LogRecords:
    """The range of `covered` records from `first` on. Records of the range that are not in `records` are unreadable.

    `records` are in rising order. Records below `oldest` were acknowledged, or are lost for ever.
    """

    VERSION: ClassVar[int] = 2
    KIND: ClassVar[Kind] = Kind.LOG_RECORDS
    HEAD: ClassVar[struct.Struct] = _BEFORE

    agent_id: int
    oldest: int
    first: int
    covered: int
    data: bytes
    """The records as their bytes in flash, one after the other: an aMussel sends them without decoding."""

    @classmethod
    def of(
        cls, agent_id: int, oldest: int, first: int, covered: int, records: Iterable[SampleRecord]
    ) -> LogRecords:
        """Makes the packet from records instead of their bytes."""
        return cls(agent_id, oldest, first, covered, b"".join([record.encode() for record in records]))

    @property
    def records(self) -> tuple[SampleRecord, ...]:
        """The readable records, in order."""
        data = self.data
        read = (SampleRecord.decode(data[at : at + RECORD_BYTES]) for at in range(0, len(data), RECORD_BYTES))
        return tuple([record for record in read if record is not None])

    def encode(self) -> bytes:
        head = self.HEAD.pack(self.VERSION, self.KIND, self.agent_id, self.oldest, self.first, self.covered)
        return sealed(head + self.data)

    @classmethod
    def decode_body(cls, body: bytes) -> LogRecords | None:
        over = len(body) - cls.HEAD.size
        if over < 0 or over % RECORD_BYTES:
            return None
        _, _, agent_id, oldest, first, covered = cls.HEAD.unpack_from(body)
        if oldest > first:
            return None
        packet = cls(agent_id, oldest, first, covered, body[cls.HEAD.size :])
        records, least = packet.records, first
        for record in records:
            if not least <= record.sequence < first + covered:
                return None
            least = record.sequence + 1
        return packet if len(records) == over // RECORD_BYTES else None
