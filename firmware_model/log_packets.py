"""Records of the log on their way to an aPad."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import ClassVar

from firmware_model.sample_record import RECORD_BYTES, SampleRecord
from firmware_model.wire import Kind, sealed

RECORDS_AT_ONCE = 40
"""In one packet, which so stays below 1024 bytes."""


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
    records: tuple[SampleRecord, ...]

    def encode(self) -> bytes:
        head = self.HEAD.pack(self.VERSION, self.KIND, self.agent_id, self.oldest, self.first, self.covered)
        return sealed(head + b"".join([record.encode() for record in self.records]))

    @classmethod
    def decode_body(cls, body: bytes) -> LogRecords | None:
        over = len(body) - cls.HEAD.size
        if over < 0 or over % RECORD_BYTES:
            return None
        _, _, agent_id, oldest, first, covered = cls.HEAD.unpack_from(body)
        if oldest > first:
            return None
        records: list[SampleRecord] = []
        least = first
        for at in range(cls.HEAD.size, len(body), RECORD_BYTES):
            record = SampleRecord.decode(body[at : at + RECORD_BYTES])
            if record is None or not least <= record.sequence < first + covered:
                return None
            records.append(record)
            least = record.sequence + 1
        return cls(agent_id, oldest, first, covered, tuple(records))
