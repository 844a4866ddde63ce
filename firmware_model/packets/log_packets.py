"""Records of the log on their way to an aPad."""

from __future__ import annotations

import struct
from collections.abc import Iterable
from dataclasses import dataclass
from typing import ClassVar

from firmware_model.packets.sample_record import RECORD_BYTES, SampleRecord
from firmware_model.packets.wire import Kind, sealed

RECORDS_AT_ONCE = 18
"""In one packet, which so stays below 512 bytes: beyond that an agent's process takes memory of another kind."""


@dataclass(frozen=True, slots=True)
class LogRecords:
    """The records from `first` on, `covered` many. Those of them that are not in `records`, which rise, cannot be read.

    Those below `oldest` were acknowledged, or are gone for ever.
    """

    VERSION: ClassVar[int] = 2
    KIND: ClassVar[Kind] = Kind.LOG_RECORDS
    HEAD: ClassVar[struct.Struct] = struct.Struct("<BBHIIB")

    agent_id: int
    oldest: int
    first: int
    covered: int
    data: bytes
    """The records as they stand in flash, one behind the other: an aMussel sends them without reading them."""

    @classmethod
    def of(
        cls, agent_id: int, oldest: int, first: int, covered: int, records: Iterable[SampleRecord]
    ) -> LogRecords:
        """From records instead of their bytes."""
        return cls(agent_id, oldest, first, covered, b"".join([record.encode() for record in records]))

    @property
    def records(self) -> tuple[SampleRecord, ...]:
        """The records, in order; those that cannot be read are left out."""
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
