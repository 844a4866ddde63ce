"""The charger's pin: an edge counts once the level has stayed for the debounce time."""

from __future__ import annotations

from enum import IntEnum


class Edge(IntEnum):
    FELL = 0
    ROSE = 1


class ChargePin:
    """Debounces raw levels. A level that flips back within `debounce_ms` never was."""

    def __init__(self, debounce_ms: int, high: bool) -> None:
        self._debounce_ms = debounce_ms
        self._raw_high = high
        self.high = high
        """The debounced level."""
        self.next_due_ms: int | None = None

    def level(self, high: bool, now_ms: int) -> None:
        """The raw level at `now_ms`; call `due` first for anything due by then."""
        if high == self._raw_high:
            return
        self._raw_high = high
        self.next_due_ms = None if high == self.high else now_ms + self._debounce_ms

    def due(self, now_ms: int) -> Edge | None:
        """The edge that has become certain by `now_ms`, once."""
        if self.next_due_ms is None or now_ms < self.next_due_ms:
            return None
        self.next_due_ms = None
        self.high = self._raw_high
        return Edge.ROSE if self.high else Edge.FELL
