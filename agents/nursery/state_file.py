"""The fleet's physical file: some records for each agent, written in turn, each with the key of the window before it.

An agent writes its record before it answers, so a record of an unanswered window may exist; it does not count. A restart
names the last answered key and its end, and the newest whole record up to both is the aMussel's state. An agent that runs
ahead writes a record for each such window, all with one key.
"""

from __future__ import annotations

import os
import struct
from binascii import crc32
from collections.abc import Sequence
from dataclasses import dataclass

from agents.hosting.link_protocol import NEVER, Key
from agents.mussel.physical import Physical

_HEAD = struct.Struct("<HIQQ")
_CRC = struct.Struct("<I")
_BODY_BYTES = _HEAD.size + Physical.FORMAT.size
RECORD_BYTES = 256
"""The room of a record, so that none crosses a page of the file."""
RECORDS = 64
"""The records of an agent, which lie side by side: one that counts, and those of windows that nobody has counted yet.

With 16 of them a flight of `bay-24` took a third more processor time, because its agents ran less far ahead.
"""
RING_BYTES = RECORDS * RECORD_BYTES


@dataclass(frozen=True, slots=True)
class StateRecord:
    """An aMussel's state at the end of window `key`, at agent time `granted_ms`."""

    key: Key
    granted_ms: int
    physical: Physical


class RecordRing:
    """One agent's records in the file open as `fd`. The ring at `index` belongs to `agent_id`."""

    def __init__(self, fd: int, index: int, agent_id: int) -> None:
        self._fd = fd
        self._offset = RING_BYTES * index
        self.agent_id = agent_id
        self._next = 0

    def initial_state(self, physical: Physical) -> None:
        """Writes the agent's first record."""
        self._next = 0
        self.write(NEVER, 0, physical)

    def write(self, key: Key, granted_ms: int, physical: Physical) -> None:
        """Overwrites the oldest record."""
        self.write_all(key, [(granted_ms, physical)])

    def write_all(self, key: Key, states: Sequence[tuple[int, Physical]]) -> None:
        """Overwrites the oldest records with these states, each at its agent time; RECORDS at most."""
        records: list[bytes] = []
        for granted_ms, physical in states:
            body = _HEAD.pack(self.agent_id, *key, granted_ms) + physical.pack()
            records.append((body + _CRC.pack(crc32(body))).ljust(RECORD_BYTES, b"\0"))
        # Side by side, because a call for each record would take an agent that runs ahead a tenth of its time.
        before_end = RECORDS - self._next
        os.pwrite(self._fd, b"".join(records[:before_end]), self._offset + RECORD_BYTES * self._next)
        if len(records) > before_end:
            os.pwrite(self._fd, b"".join(records[before_end:]), self._offset)
        self._next = (self._next + len(records)) % RECORDS

    def take_back(self, count: int) -> None:
        """The next writes overwrite the last `count` records, which do not count; RECORDS - 1 at most."""
        self._next = (self._next - count) % RECORDS

    def newest(self, up_to: Key | None, until_ms: int | None = None) -> StateRecord | None:
        """The newest whole record with a key up to `up_to` and an end up to `until_ms` (any, if None).

        The next writes spare it.
        """
        found: StateRecord | None = None
        ring = os.pread(self._fd, RING_BYTES, self._offset)
        for which in range(RECORDS):
            record = self._decoded(ring[RECORD_BYTES * which :][:RECORD_BYTES])
            if record is None or (up_to is not None and record.key > up_to):
                continue
            if until_ms is not None and record.granted_ms > until_ms:
                continue
            if found is None or (record.key, record.granted_ms) > (found.key, found.granted_ms):
                found = record
                self._next = (which + 1) % RECORDS
        return found

    def _decoded(self, data: bytes) -> StateRecord | None:
        """The record in `data`; None if it is torn, or another agent's."""
        if (
            len(data) < _BODY_BYTES + _CRC.size
            or crc32(data[:_BODY_BYTES]) != _CRC.unpack_from(data, _BODY_BYTES)[0]
        ):
            return None
        agent_id, epoch, sequence, granted_ms = _HEAD.unpack_from(data)
        if agent_id != self.agent_id:
            return None
        return StateRecord((epoch, sequence), granted_ms, Physical.unpack(data[_HEAD.size : _BODY_BYTES]))
