"""The true way of a hull, and a fence around it, by the judge's own geometry: standard library only."""

from __future__ import annotations

import math
from bisect import bisect_right
from typing import Any

Place = tuple[float, float]
Fact = dict[str, Any]
REST_M, REST_S = 0.15, 3.0
SPEED_S = 0.5
"""A speed is that of the way from so long before to so long after."""


def is_inside(place: Place, corners: tuple[Place, ...]) -> bool:
    """By the sum of the angles under which the corners are seen: a whole turn from inside, none from outside."""
    turn = 0.0
    for a, b in zip(corners, (*corners[1:], corners[0]), strict=True):
        ax, ay, bx, by = a[0] - place[0], a[1] - place[1], b[0] - place[0], b[1] - place[1]
        turn += math.atan2(ax * by - ay * bx, ax * bx + ay * by)
    return abs(turn) > math.pi


def edge_m(place: Place, corners: tuple[Place, ...]) -> float:
    """The distance to the fence's edge."""
    best = math.inf
    for a, b in zip(corners, (*corners[1:], corners[0]), strict=True):
        dx, dy = b[0] - a[0], b[1] - a[1]
        along = ((place[0] - a[0]) * dx + (place[1] - a[1]) * dy) / (dx * dx + dy * dy)
        along = min(1.0, max(0.0, along))
        best = min(best, math.dist(place, (a[0] + along * dx, a[1] + along * dy)))
    return best


def out_m(place: Place, corners: tuple[Place, ...]) -> float:
    """Metres outside the fence; 0 inside."""
    if not all(map(math.isfinite, place)):
        return math.inf
    return 0.0 if is_inside(place, corners) else edge_m(place, corners)


def way_out_m(start: Place, goal: Place, corners: tuple[Place, ...], step_m: float = 0.25) -> float:
    """The greatest distance outside the fence on the straight way."""
    if not all(map(math.isfinite, goal)):
        return math.inf
    steps = max(1, math.ceil(math.dist(start, goal) / step_m))
    return max(
        out_m(
            (start[0] + (goal[0] - start[0]) * it / steps, start[1] + (goal[1] - start[1]) * it / steps),
            corners,
        )
        for it in range(steps + 1)
    )


class Track:
    """The true positions."""

    def __init__(self, facts: list[Fact]) -> None:
        truths = [it for it in facts if it["fact"] == "truth"]
        self.times_s = [it["at_s"] for it in truths]
        self.places: list[Place] = [(it["north"], it["east"]) for it in truths]
        # By the hull's own clock: a node that hung tells afterwards where it was.
        off_s = min((it["at_s"] - it["stamp"] for it in truths), default=0.0)
        self._stamped = sorted((it["stamp"] + off_s, (it["north"], it["east"])) for it in truths)

    def at(self, at_s: float) -> Place | None:
        number = bisect_right(self.times_s, at_s) - 1
        return self.places[number] if number >= 0 else None

    def since(self, at_s: float) -> list[tuple[float, Place]]:
        number = bisect_right(self.times_s, at_s)
        return list(zip(self.times_s[number:], self.places[number:], strict=True))

    def speed_m_s(self, at_s: float, current_m_s: Place = (0.0, 0.0)) -> float:
        """The true speed through water that flows so; 0 where nothing is known."""
        return math.hypot(*self.velocity_m_s(at_s, current_m_s))

    def velocity_m_s(self, at_s: float, current_m_s: Place = (0.0, 0.0)) -> Place:
        (begin_s, begin), (end_s, end) = self._stamp_at(at_s - SPEED_S), self._stamp_at(at_s + SPEED_S)
        if end_s <= begin_s:
            return 0.0, 0.0
        lasts_s = max(end_s - begin_s, SPEED_S)
        north_m_s, east_m_s = ((b - a) / lasts_s for a, b in zip(begin, end, strict=True))
        return north_m_s - current_m_s[0], east_m_s - current_m_s[1]

    def _stamp_at(self, at_s: float) -> tuple[float, Place]:
        number = bisect_right(self._stamped, at_s, key=lambda it: it[0]) - 1
        return self._stamped[max(0, number)] if self._stamped else (at_s, (0.0, 0.0))

    def leaves_s(self, at_s: float, radius_m: float) -> float:
        """The time at which it is so far from where it was at `at_s`; infinite if it never is."""
        begin = self.at(at_s)
        far = (
            it for it, place in self.since(at_s) if begin is not None and math.dist(begin, place) > radius_m
        )
        return next(far, math.inf)

    def ends_at_rest(self, rest_m: float = REST_M) -> bool:
        ends_s = self.times_s[-1] if self.times_s else 0.0
        places = [place for at_s, place in self.since(ends_s - REST_S)]
        return all(math.dist(places[0], it) < rest_m for it in places)

    def rest(self, since_s: float, rest_m: float = REST_M) -> tuple[float, float] | None:
        """Seconds from `since_s` until it stays where it is, and the metres that it came away meanwhile."""
        begin = self.at(since_s)
        rows = self.since(since_s)
        if begin is None or not rows:
            return None
        furthest_m = 0.0
        for number, (at_s, place) in enumerate(rows):
            furthest_m = max(furthest_m, math.dist(begin, place))
            later = [other for then_s, other in rows[number:] if then_s <= at_s + REST_S]
            if rows[-1][0] < at_s + REST_S:
                return None
            if all(math.dist(place, other) < rest_m for other in later):
                return at_s - since_s, furthest_m
        return None
