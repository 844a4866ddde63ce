"""A whole board's flash, which may not answer, and whose writes may be torn, stick or be cut by a brown-out."""

from __future__ import annotations

from agents.mussel.board_parts import BoardPart
from agents.mussel.firmware_failure import PowerLost
from firmware_model.sampling.flash import Flash


class FailingFlash:
    """A `Flash` in front of the board's own. `parts` are those of this board that fail, with their values."""

    def __init__(self, flash: Flash, parts: dict[BoardPart, int]) -> None:
        self._flash = flash
        self.pages, self.page_bytes = flash.pages, flash.page_bytes
        self._parts = parts
        self._stale: set[int] = set()
        """The pages whose erasure failed: their old bytes are still there."""

    def read(self, at: int, size: int) -> bytes:
        """A flash that does not answer reads as an erased one, because nothing drives its line."""
        return bytes(size) if BoardPart.FLASH in self._parts else self._flash.read(at, size)

    def program(self, at: int, data: bytes) -> None:
        """Programs what the defects leave of `data`; PowerLost once if the supply fails in its middle.

        Nothing is programmed where an erasure failed.
        """
        parts = self._parts
        if BoardPart.FLASH in parts or (
            at // self.page_bytes in self._stale and any(self.read(at, len(data)))
        ):
            return
        if parts:
            cells = 0xFF & ~parts.get(BoardPart.CELLS, 0)
            data = bytes(byte & cells for byte in data)[: parts.get(BoardPart.WRITES, len(data))]
            if (reached := parts.pop(BoardPart.SUPPLY, None)) is not None:
                self._flash.program(at, data[:reached])
                raise PowerLost
        self._flash.program(at, data)

    def erase(self, page: int) -> None:
        if BoardPart.FLASH in self._parts:
            self._stale.add(page)
            return
        self._stale.discard(page)
        self._flash.erase(page)
