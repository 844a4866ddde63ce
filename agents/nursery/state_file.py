"""The fleet's physical file: for each agent two slots, written in turn, each with the key of the window that ended so.

An agent writes its slot before it answers, so that a slot of an unanswered window may exist: it does not count. Whoever
restarts an agent names the last answered key, and the newest whole slot up to that key is what the aMussel is.
"""

from __future__ import annotations

import os
import struct
from binascii import crc32
from dataclasses import dataclass

from agents.hosting.link_protocol import NEVER, Key
from agents.mussel.physical import Physical

_HEAD = struct.Struct("<HIQQ")
_CRC = struct.Struct("<I")
_BODY_BYTES = _HEAD.size + Physical.FORMAT.size
SLOT_BYTES = 256
"""Room for a slot, so that none crosses a page of the file."""
PAIR_BYTES = 2 * SLOT_BYTES
"""An agent's two slots lie side by side."""


@dataclass(frozen=True, slots=True)
class Record:
    """An aMussel at the end of window `key`, at agent time `granted_ms`."""

    key: Key
    granted_ms: int
    physical: Physical


class RecordPair:
    """One agent's two slots in the file open as `fd`. The pair at `index` belongs to `agent_id`."""

    def __init__(self, fd: int, index: int, agent_id: int) -> None:
        self._fd = fd
        self._offset = PAIR_BYTES * index
        self.agent_id = agent_id
        self._next = 0

    def initial_state(self, physical: Physical) -> None:
        """Writes what the agent is born with."""
        self._next = 0
        self.write(NEVER, 0, physical)

    def write(self, key: Key, granted_ms: int, physical: Physical) -> None:
        """Overwrites the slot that is not the newest committed one."""
        body = _HEAD.pack(self.agent_id, *key, granted_ms) + physical.pack()
        os.pwrite(self._fd, body + _CRC.pack(crc32(body)), self._offset + SLOT_BYTES * self._next)
        self._next = 1 - self._next

    def newest(self, up_to: Key | None) -> Record | None:
        """The newest whole slot with a key up to `up_to` (any, when None). The next write spares it."""
        found: Record | None = None
        for which in (0, 1):
            slot = self._read(which)
            if slot is None or (up_to is not None and slot.key > up_to):
                continue
            if found is None or slot.key > found.key:
                found = slot
                self._next = 1 - which
        return found

    def _read(self, which: int) -> Record | None:
        data = os.pread(self._fd, _BODY_BYTES + _CRC.size, self._offset + SLOT_BYTES * which)
        if (
            len(data) < _BODY_BYTES + _CRC.size
            or crc32(data[:_BODY_BYTES]) != _CRC.unpack_from(data, _BODY_BYTES)[0]
        ):
            return None
        agent_id, epoch, sequence, granted_ms = _HEAD.unpack_from(data)
        if agent_id != self.agent_id:
            return None
        return Record((epoch, sequence), granted_ms, Physical.unpack(data[_HEAD.size : _BODY_BYTES]))
