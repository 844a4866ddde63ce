"""The charger's pin: what its wire carries, which of that the firmware saw, and the level that it holds for certain.

An edge counts once the level has stayed for the debounce time. A pin that goes on bouncing faster than that is decided
every `chatter_ms` by the level that it had for the greater part of the time; a tie leaves the level as it was. An edge
whose interrupt was lost is found by the level, which is sampled at every wake and at whole multiples of `check_ms`; a
sample that agrees changes nothing, so only the first that does not is an event.
"""

from __future__ import annotations

from enum import Enum, IntEnum


class Edge(IntEnum):
    FELL = 0
    ROSE = 1


class Fault(Enum):
    """What was wrong with the pin; the board counts it."""

    MISSED = "an edge of the charger's pin was missed: its level told"
    CHATTER = "the charger's pin chatters: the greater part of the time decided"


class ChargePin:
    """The debouncer. `next_due_ms` and `due` as everywhere; times are milliseconds that never go back."""

    def __init__(self, debounce_ms: int, high: bool, chatter_ms: int, check_ms: int) -> None:
        self._debounce_ms = debounce_ms
        self._chatter_ms = chatter_ms
        self._check_ms = check_ms
        self.restart(high)

    def restart(self, high: bool) -> None:
        """The firmware begins, and reads this level."""
        self.wire_high = high
        """What the pin carries, whether the firmware saw it or not: the chargers run on it."""
        self.high = high
        """The debounced level."""
        self._seen_high = high
        self._flipped_ms: int | None = None
        """The last flip that was seen since the level was certain."""
        self._unsettled_ms = self._counted_ms = self._high_ms = 0
        """Since when it is not certain, up to when that was counted, and for how much of it the level was high."""
        self.next_due_ms: int | None = None

    def level(self, high: bool, now_ms: int) -> None:
        """The wire's level from `now_ms` on, its edge seen; call `due` first for anything due by then."""
        self.wire_high = high
        self.look(now_ms)

    def level_unseen(self, high: bool, now_ms: int) -> None:
        """As `level`, but the interrupt was lost."""
        self.wire_high = high
        if self._flipped_ms is None:
            differs = high != self._seen_high
            self.next_due_ms = (now_ms // self._check_ms + 1) * self._check_ms if differs else None

    def look(self, now_ms: int) -> bool:
        """Reads the level; whether it is another than the one last seen."""
        if self.wire_high == self._seen_high:
            if self._flipped_ms is None:
                self.next_due_ms = None
            return False
        if self._flipped_ms is None:
            self._unsettled_ms = self._counted_ms = now_ms
            self._high_ms = 0
        self._count(now_ms)
        self._seen_high, self._flipped_ms = self.wire_high, now_ms
        self._wait()
        return True

    def due(self, now_ms: int) -> tuple[Edge | None, Fault | None]:
        """What has become certain by `now_ms`, once, and what was wrong."""
        if self.next_due_ms is None or now_ms < self.next_due_ms:
            return None, None
        if self.look(now_ms):
            return None, Fault.MISSED
        assert self._flipped_ms is not None
        if now_ms >= self._flipped_ms + self._debounce_ms:
            self._flipped_ms = self.next_due_ms = None
            return self._certain(self._seen_high), None
        self._count(now_ms)
        more_high_ms = 2 * self._high_ms - (now_ms - self._unsettled_ms)
        self._unsettled_ms, self._high_ms = now_ms, 0
        self._wait()
        return self._certain(self.high if more_high_ms == 0 else more_high_ms > 0), Fault.CHATTER

    def _count(self, now_ms: int) -> None:
        if self._seen_high:
            self._high_ms += now_ms - self._counted_ms
        self._counted_ms = now_ms

    def _wait(self) -> None:
        assert self._flipped_ms is not None
        self.next_due_ms = min(self._flipped_ms + self._debounce_ms, self._unsettled_ms + self._chatter_ms)

    def _certain(self, high: bool) -> Edge | None:
        if high == self.high:
            return None
        self.high = high
        return Edge.ROSE if high else Edge.FELL
