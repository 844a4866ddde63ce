"""The charger's pin: the level on its wire, the level that the firmware last saw, and the debounced level.

An edge counts once the level has stayed for the debounce time. If the pin goes on bouncing faster than that, the level of
the greater part of the time decides every `chatter_ms`; a tie leaves the level as it was. The firmware also samples the
level at every wake and at whole multiples of `check_ms`, also while it waits, which finds an edge whose interrupt was lost.
A sample that agrees changes nothing, so only the first one that differs is an event.
"""

from __future__ import annotations

from enum import Enum, IntEnum

COUNTER_WRAPS_MS = 131_072_000
"""The board's counter of 32 bits and 32 768 Hz begins anew. The checks go on as they were, until a reset reads it again."""


class Edge(IntEnum):
    FELL = 0
    ROSE = 1


class PinFault(Enum):
    """A fault of the pin; the board counts it."""

    MISSED = "an edge of the charger's pin was missed: its level told"
    CHATTER = "the charger's pin chatters: the greater part of the time decided"


class ChargePin:
    """The debouncer. `next_due_ms` and `due` as everywhere; times are milliseconds that never go back."""

    def __init__(self, debounce_ms: int, high: bool, chatter_ms: int, check_ms: int) -> None:
        self._debounce_ms = debounce_ms
        self._chatter_ms = chatter_ms
        self._check_ms = check_ms
        self.restart(high, 0)

    def restart(self, high: bool, now_ms: int) -> None:
        """The firmware starts and reads this level and the counter."""
        self._counter_began_ms = now_ms - now_ms % COUNTER_WRAPS_MS
        self.wire_high = high
        """The level on the wire, even if the firmware did not see its edge: it controls the chargers."""
        self.high = high
        """The debounced level."""
        self._seen_high = high
        self._flipped_ms: int | None = None
        """The last edge that was seen since the level was certain."""
        self._unsettled_ms = self._counted_ms = self._high_ms = 0
        """The start of the uncertain time, the end of the counted part, and the time at a high level in that part."""
        self.next_due_ms: int | None = None

    def level(self, high: bool, now_ms: int) -> None:
        """Sets the wire's level from `now_ms` on, with its edge seen; call `due` first for anything due by then."""
        self.wire_high = high
        self.sample_level(now_ms)

    def level_unseen(self, high: bool, now_ms: int) -> None:
        """Sets the wire's level from `now_ms` on, with the edge's interrupt lost."""
        self.wire_high = high
        self._wait(now_ms)

    def sample_level(self, now_ms: int) -> bool:
        """Samples the level; returns True if it differs from the level last seen."""
        if self.wire_high == self._seen_high:
            self._wait(now_ms)
            return False
        if self._flipped_ms is None:
            self._unsettled_ms = self._counted_ms = now_ms
            self._high_ms = 0
        self._count(now_ms)
        self._seen_high, self._flipped_ms = self.wire_high, now_ms
        self._wait(now_ms)
        return True

    def due(self, now_ms: int) -> tuple[Edge | None, PinFault | None]:
        """Returns the edge that has become certain by `now_ms`, once, and the fault of the pin."""
        if self.next_due_ms is None or now_ms < self.next_due_ms:
            return None, None
        if self.sample_level(now_ms):
            return None, PinFault.MISSED
        assert self._flipped_ms is not None
        if now_ms >= self._flipped_ms + self._debounce_ms:
            self._flipped_ms = self.next_due_ms = None
            return self._certain(self._seen_high), None
        self._count(now_ms)
        more_high_ms = 2 * self._high_ms - (now_ms - self._unsettled_ms)
        self._unsettled_ms, self._high_ms = now_ms, 0
        self._wait(now_ms)
        return self._certain(self.high if more_high_ms == 0 else more_high_ms > 0), PinFault.CHATTER

    def _count(self, now_ms: int) -> None:
        if self._seen_high:
            self._high_ms += now_ms - self._counted_ms
        self._counted_ms = now_ms

    def _wait(self, now_ms: int) -> None:
        """Sets the time of the next event; an edge that was not seen is found at the next check."""
        due_ms: int | None = None
        if self._flipped_ms is not None:
            due_ms = min(self._flipped_ms + self._debounce_ms, self._unsettled_ms + self._chatter_ms)
        if self.wire_high != self._seen_high:
            check_ms = now_ms + self._check_ms - (now_ms - self._counter_began_ms) % self._check_ms
            due_ms = check_ms if due_ms is None else min(due_ms, check_ms)
        self.next_due_ms = due_ms

    def _certain(self, high: bool) -> Edge | None:
        if high == self.high:
            return None
        self.high = high
        return Edge.ROSE if high else Edge.FELL
