"""The search for an aMussel that does not float within the catch radius: the points at which the docking is tried.

The first is the place that is believed now, the next ones lie along a square spiral about it, which moves with the belief.
An aMussel whose reports run away from the spiral drifts, in wind for example: the search then leads it by as far as it
drifts until the aPad is there.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass

from agents.time_scale import MissionMs
from apad_bridge.beliefs.belief import Belief
from apad_bridge.scenario.blocks.mission_options import Mission
from apad_bridge.vehicle.commands import CloseDock

_DRIFT_MS = 60_000
_FEWEST_REPORTS = 3
_DRIFTED_PITCHES = 3.0
"""Reports that moved less than this many catch radii in that time show their own errors, and no drift."""
SEARCH_S = 120.0
"""A search that has not caught its aMussel after so long is over."""
NOT_FOUND = f"it was not found within the catch radius in a search of {SEARCH_S:g} s"


def square_spiral() -> Iterator[tuple[int, int]]:
    """The points (north, east) of the plane's square grid from the origin outwards, each next to the one before it."""
    north, east = 0, 0
    yield north, east
    for turn in itertools.count():
        steps, (to_north, to_east) = turn // 2 + 1, ((1, 0), (0, 1), (-1, 0), (0, -1))[turn % 4]
        for _ in range(steps):
            north, east = north + to_north, east + to_east
            yield north, east


class DockingSearch:
    """The points to try for an aMussel that the catch radius does not hold."""

    def __init__(self, order: CloseDock, until_ms: int, config: Mission) -> None:
        self.order = order
        """The docking to try at each point."""
        self.until_ms = until_ms
        self.pitch_m = config.docking.catch_radius_m
        self._speed_m_s = config.speed_m_s
        self._spiral = square_spiral()
        self._last: Belief | None = None
        """The belief at the last point."""
        self._reports: list[Belief] = []
        """The beliefs of the last `_DRIFT_MS`, each when the search first saw its report."""
        self._drift: _Drift | None = None
        self.go_to_id: int | None = None
        """The id of the go-to under way; None while a docking is tried."""

    def next_point(self, belief: Belief, here: tuple[float, float], now_ms: MissionMs) -> tuple[float, float]:
        """The next point (north, east) in metres. A report from elsewhere than expected begins the spiral anew.

        The aPad at `here` has tried the believed place already if it is there.
        """
        self._note(belief)
        centre_m = self._expected(belief, here, now_ms)
        north, east = next(self._spiral)
        if (north, east) == (0, 0) and math.dist(centre_m, here) < self.pitch_m / 2:
            north, east = next(self._spiral)
        return centre_m[0] + self.pitch_m * north, centre_m[1] + self.pitch_m * east

    def _note(self, belief: Belief) -> None:
        """Takes a report, and begins the spiral anew for one from elsewhere than expected."""
        last, self._last = self._last, belief
        if last is not None and belief.heard_ms == last.heard_ms:
            return
        if last is not None:
            expected_m = (
                (last.north_m, last.east_m) if self._drift is None else self._drift.place_m(belief.at_ms)
            )
            if math.dist((belief.north_m, belief.east_m), expected_m) > self.pitch_m:
                self._spiral = square_spiral()
        self._reports = [it for it in self._reports if belief.at_ms - it.at_ms <= _DRIFT_MS] + [belief]
        self._drift = _Drift.of(self._reports, _DRIFTED_PITCHES * self.pitch_m)

    def _expected(self, belief: Belief, here: tuple[float, float], now_ms: MissionMs) -> tuple[float, float]:
        """The place when the aPad is there."""
        place_m = belief.north_m, belief.east_m
        if self._drift is None:
            return place_m
        for _ in range(3):  # the way depends on the place
            place_m = self._drift.place_m(now_ms + 1000 * math.dist(here, place_m) / self._speed_m_s)
        return place_m


@dataclass(frozen=True, slots=True)
class _Drift:
    """A straight line through reports, by least squares: a place at a time, and a velocity."""

    at_ms: float
    north_m: float
    east_m: float
    north_m_s: float
    east_m_s: float

    @classmethod
    def of(cls, reports: list[Belief], least_m: float) -> _Drift | None:
        """None for reports that moved less than `least_m` from the first to the last, which may be their errors.

        Two reports cannot tell a drift from a correction of the first.
        """
        count = len(reports)
        if count < _FEWEST_REPORTS:
            return None
        at_ms = math.fsum(it.at_ms for it in reports) / count
        square_s2 = math.fsum((it.at_ms - at_ms) ** 2 for it in reports) / 1e6
        weights = [(it.at_ms - at_ms) / 1000 / square_s2 for it in reports]
        north_m_s = math.fsum(weight * it.north_m for weight, it in zip(weights, reports, strict=True))
        east_m_s = math.fsum(weight * it.east_m for weight, it in zip(weights, reports, strict=True))
        span_s = (reports[-1].at_ms - reports[0].at_ms) / 1000
        if math.hypot(north_m_s, east_m_s) * span_s < least_m:
            return None
        north_m = math.fsum(it.north_m for it in reports) / count
        east_m = math.fsum(it.east_m for it in reports) / count
        return cls(at_ms, north_m, east_m, north_m_s, east_m_s)

    def place_m(self, at_ms: float) -> tuple[float, float]:
        passed_s = (at_ms - self.at_ms) / 1000
        return self.north_m + passed_s * self.north_m_s, self.east_m + passed_s * self.east_m_s
