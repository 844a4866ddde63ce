"""One sample as a record in flash and over Wi-Fi, with a check of its own: 24 bytes with four sensors."""

from __future__ import annotations

import struct
from binascii import crc_hqx
from dataclasses import dataclass
from typing import ClassVar

from firmware_model.packets.wire import sealed, unsealed
from firmware_model.sampling.sensors import COUNT_FIELDS, LAYOUT, Counts

_FORMAT = struct.Struct(f"<BBIQ{COUNT_FIELDS}")
RECORD_BYTES = _FORMAT.size + 2


@dataclass(frozen=True, slots=True)
class SampleRecord:
    """Sample number `sequence`, from 0 on, of one aMussel; `agent_ms` is its own time.

    `saturated` has a bit for each sensor, in the order of `counts`, whose reading lay outside its range.
    """

    VERSION: ClassVar[int] = 1 + LAYOUT
    FORMAT: ClassVar[struct.Struct] = _FORMAT

    sequence: int
    agent_ms: int
    counts: Counts
    saturated: int

    def encode(self) -> bytes:
        return sealed(
            self.FORMAT.pack(self.VERSION, self.saturated, self.sequence, self.agent_ms, *self.counts)
        )

    @classmethod
    def is_whole(cls, data: bytes, sequence: int) -> bool:
        """True if these bytes are an undamaged record of that sequence."""
        return (
            len(data) == RECORD_BYTES
            and data[0] == cls.VERSION
            and int.from_bytes(data[2:6], "little") == sequence
            and crc_hqx(data[:-2], 0xFFFF) == int.from_bytes(data[-2:], "little")
        )

    @classmethod
    def decode(cls, data: bytes) -> SampleRecord | None:
        """The record, or None for bytes that are not a complete, undamaged one."""
        body = unsealed(data) if len(data) == RECORD_BYTES else None
        if body is None or body[0] != cls.VERSION:
            return None
        _, saturated, sequence, agent_ms, *counts = cls.FORMAT.unpack(body)
        return cls(sequence, agent_ms, tuple(counts), saturated)
