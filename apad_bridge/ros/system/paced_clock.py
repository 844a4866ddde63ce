"""The rule by which a /clock runs `speed` times as fast as the wall clock, and waits for those who follow it.

    clock = PacedClock(start_ms, speed)
    clock.hear(name, reached_ms)          # a follower has handled everything before that time
    clock.keep(names)                     # the followers that are still connected
    left_out = clock.advance(elapsed_s)   # wall seconds since the last call
    clock.now_ms

Patience with a vehicle's answers is mission time. On a busy machine a clock that only followed the wall clock would use it
up while a vehicle, or the program that waits for its answer, has no processor.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

LEAD_MS = 1000
"""The clock never goes further than this beyond a time up to which a follower has still to act. A supervisor has handled
everything before its next tick, so it may act a whole tick later without holding the clock."""
PATIENCE_S = 5.0
"""Wall seconds that the clock waits for a follower that comes no further: it was stopped, or its machine was lost. Less
than those after which a supervisor gives up a clock that stands still (`ros_pace.STANDSTILL_S`)."""
_LONGEST_STEP_S = 0.1
"""A clock that had no processor itself does not make up for that: its followers had perhaps none either."""


@dataclass(slots=True)
class _Follower:
    reached_ms: int
    held_s: float = 0.0
    """Wall seconds for which it has held the clock without coming further."""
    is_left_out: bool = False


class PacedClock:
    """Starts at `start_ms`. Followers have a name each; one that was never heard is not waited for."""

    def __init__(self, start_ms: int, speed: float) -> None:
        self._start_ms = start_ms
        self._now_ms = float(start_ms)
        self._speed = speed
        self._followers: dict[str, _Follower] = {}

    @property
    def now_ms(self) -> int:
        return int(self._now_ms)

    def hear(self, name: str, reached_ms: int) -> bool:
        """Takes a follower's word that it has handled everything before a time; True if it had been left out until now.

        A time before this clock's start is about another clock, which was there before.
        """
        if reached_ms < self._start_ms:
            return False
        follower = self._followers.setdefault(name, _Follower(reached_ms))
        if reached_ms <= follower.reached_ms:
            return False
        was_left_out = follower.is_left_out
        follower.reached_ms, follower.held_s, follower.is_left_out = reached_ms, 0.0, False
        return was_left_out

    def keep(self, names: Collection[str]) -> None:
        """Forgets all other followers: they have ended, and nobody waits for them."""
        self._followers = {name: it for name, it in self._followers.items() if name in names}

    def advance(self, elapsed_s: float) -> list[str]:
        """Lets so many wall seconds pass; the followers for which the clock waits no more from now on."""
        elapsed_s = min(elapsed_s, _LONGEST_STEP_S)
        wanted_ms = self._now_ms + elapsed_s * 1000 * self._speed
        left_out = []
        for name, it in self._followers.items():
            if it.is_left_out or it.reached_ms + LEAD_MS >= wanted_ms:
                continue
            it.held_s += elapsed_s
            if it.held_s >= PATIENCE_S:
                it.is_left_out = True
                left_out.append(name)
        limits_ms = [it.reached_ms + LEAD_MS for it in self._followers.values() if not it.is_left_out]
        self._now_ms = max(self._now_ms, min([wanted_ms, *limits_ms]))
        return left_out
