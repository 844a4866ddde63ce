"""Judges by the position alone whether the hull obeys a stop that its vehicle has taken.

A service's answer says that a program took the order. A hull whose thrusters ignore it, or push the wrong way, answers as
well. Three rules find it out:

- A hull that was faster than `SLOW_M_S` over the water's own flow when the stop was taken slows as its coasting says. It
  does not obey if, from the first second on, it makes more way than one that lost half of that speed would.
- A speed is a mean over two seconds, so a hull that gains speed is faster. One that does not stand is judged after a
  second, and has not slowed while it still gains speed.
- Under HOLD, the hull does not obey if it is farther from the held place than its coasting and `RECEDES_MS` long has gone
  away from it.

The noise of the position widens the ways of both others (`PositionNoise.way_error_m`).
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from enum import Enum, auto

from apad_bridge.events.guard_events import StopKind
from apad_bridge.vehicle.guards.guarded_orders import Point
from apad_bridge.vehicle.guards.monitor import Stopping

SLOW_M_S = 0.3
"""A hull that is no faster than this over the water's own flow has nothing to lose."""
STANDS_M_S = 0.05
"""A hull that stands by its last positions is slower than `SLOW_M_S`, whatever it has just begun."""
DELAY_MS = 1_000
"""The vehicle's controllers may act so long after its answer."""
SLOWS_MS = 3_000
"""A hull that has not begun to slow after so long does not obey."""
SLOWED_SHARE = 0.7
"""A hull with less than this share of its speed slows."""
RECEDES_MS = 3_000
MEMORY_MS = 15_000
"""The way from the held place is followed for so long."""


class Obeys(Enum):
    YES = auto()
    NO = auto()
    UNKNOWN = auto()


@dataclass(frozen=True, slots=True)
class Sight:
    """The hull at a time: place (m), velocity over ground (m/s), known flow (m/s), and the error of a way between two
    positions (m)."""

    at_ms: int
    place_m: Point
    velocity_m_s: Point
    flow_m_s: Point = (0.0, 0.0)
    error_m: float = 0.0

    @property
    def speed_m_s(self) -> float:
        """The speed over the water's own flow."""
        return math.dist(self.velocity_m_s, self.flow_m_s)


class Obedience:
    """Follows one stop, from its acceptance on. `reason` tells how the hull goes on, after an `Obeys.NO`."""

    def __init__(self, kind: StopKind, held_m: Point | None, stopping: Stopping, taken: Sight) -> None:
        self._kind = kind
        self._held_m = held_m
        self._stopping = stopping
        self._taken = taken
        self._speed_m_s = taken.speed_m_s
        """The speed of which the hull has to lose some."""
        self._first: Sight | None = None
        """The first sight from which on the hull's way counts."""
        self._has_slowed = min(taken.speed_m_s, math.hypot(*taken.velocity_m_s)) <= STANDS_M_S
        self._away: deque[tuple[int, float]] = deque()
        """The times of the last `MEMORY_MS`, and the distance from the held place at each."""
        self.reason = ""

    def look(self, sight: Sight) -> Obeys:
        if self._recedes(sight):
            return Obeys.NO
        if self._has_slowed:
            return Obeys.YES
        after_ms = sight.at_ms - self._taken.at_ms
        if self._first is None and self._taken.speed_m_s <= SLOW_M_S:
            self._speed_m_s = max(self._speed_m_s, sight.speed_m_s)
        if after_ms < DELAY_MS:
            return Obeys.UNKNOWN
        if self._first is None:
            self._first = sight
        gains = self._taken.speed_m_s <= SLOW_M_S and sight.speed_m_s > self._taken.speed_m_s + STANDS_M_S
        if sight.speed_m_s <= max(0.0 if gains else SLOW_M_S, SLOWED_SHARE * self._speed_m_s):
            self._has_slowed = True
            return Obeys.YES
        if after_ms >= SLOWS_MS and (reason := self._goes_on(self._first, sight)):
            self.reason = reason
            return Obeys.NO
        return Obeys.UNKNOWN

    def _goes_on(self, first: Sight, now: Sight) -> str:
        """The reason why the hull has not slowed since the first sight; empty where it may have."""
        seconds = (now.at_ms - first.at_ms) / 1000
        speed_m_s = self._speed_m_s
        way_m = (
            math.dist(
                now.place_m,
                (
                    first.place_m[0] + first.flow_m_s[0] * seconds,
                    first.place_m[1] + first.flow_m_s[1] * seconds,
                ),
            )
            - now.error_m
        )
        # Coasting by an exponential, as of a drag that grows with the speed: the way to rest is speed x decay.
        decay_s = self._stopping.way_m(speed_m_s) / speed_m_s
        before_s = (first.at_ms - self._taken.at_ms) / 1000
        coasted_m = (
            speed_m_s * decay_s * (math.exp(-before_s / decay_s) - math.exp(-(before_s + seconds) / decay_s))
            if decay_s > 0
            else 0.0
        )
        if way_m <= (coasted_m + speed_m_s * seconds) / 2:
            return ""
        return f"it made {speed_m_s:.1f} m/s, and {way_m:.1f} m or more in {seconds:.0f} s since"

    def _recedes(self, sight: Sight) -> bool:
        """True for a hull under HOLD that is too far from the held place, and goes farther and farther away."""
        if self._kind is not StopKind.HOLD or self._held_m is None:
            return False
        away_m = math.dist(self._held_m, sight.place_m)
        self._away.append((sight.at_ms, away_m))
        while sight.at_ms - self._away[0][0] > MEMORY_MS:
            self._away.popleft()
        farthest_m = max(it for _, it in self._away)
        allowed_m = self._stopping.way_m(max(self._taken.speed_m_s, self._stopping.coasting_speed_m_s))
        if away_m <= allowed_m + sight.error_m or away_m < farthest_m:
            return False
        before = [it for at_ms, it in self._away if sight.at_ms - at_ms >= RECEDES_MS]
        if not before or away_m - min(before) <= sight.error_m:
            return False
        self.reason = f"it is {away_m:.1f} m from the held place, and goes farther away"
        return True
