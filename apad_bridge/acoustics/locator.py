"""Locates aMussels from ranges that aPads took on their ways: each place from which a range was taken is an anchor."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass

import numpy as np

from agents.time_scale import MissionMs
from apad_bridge.acoustics.least_squares import Floats, NoFix, PlaceSolution, mirrored, solve
from apad_bridge.beliefs.input_ranges import out_of_range
from apad_bridge.events.sound_events import PlaceFixed
from apad_bridge.scenario.water.water_options import Localisation

AMBIGUOUS = 9.0
"""Ranges do not separate two places whose weighted squared residuals differ by less: three standard deviations."""
_AT_LEAST = 3
"""The fewest ranges for a fix."""
_GATE = 16.0
"""A range whose squared residual exceeds so many variances is an outlier; a fix leaves out the worst one."""


@dataclass(frozen=True, slots=True)
class RangeTaken:
    """A range: at mission time `at_ms` an aPad's modem at this place was `range_m` from the aMussel's modem.

    Places are metres, depth positive down. A run's physical modem gives no ranges, because it hangs at a jetty. That of a
    bridge to real aMussels hangs at the aPad.
    """

    at_ms: MissionMs
    agent_id: int
    range_m: float
    north_m: float
    east_m: float
    depth_m: float


class Locator:
    """Turns ranges into fixes. `dropped` counts, by reason, the ranges that gave none."""

    def __init__(self, config: Localisation, depth_m: float) -> None:
        """`depth_m` is the bottom's, on which the aMussels lie."""
        self.dropped: Counter[str] = Counter()
        self._config = config
        self._depth_m = depth_m
        self._ranges: dict[int, list[RangeTaken]] = {}

    def forget(self, agent_id: int) -> None:
        """Drops an aMussel's ranges, because it was moved and they are no longer valid."""
        self._ranges.pop(agent_id, None)

    def take(self, taken: RangeTaken, near_m: tuple[float, float] | None = None) -> PlaceFixed | None:
        """Takes a range and returns the fix from all ranges of this aMussel, or None. `near_m` is its believed place."""
        reason = out_of_range(
            range_m=taken.range_m, north_m=taken.north_m, east_m=taken.east_m, depth_m=taken.depth_m
        )
        if reason is not None:
            self.dropped[f"a range: {reason}"] += 1
            return None
        self.remember(taken)
        try:
            solution, used = self._solve(self._ranges[taken.agent_id], near_m)
        except NoFix as reason:
            self.dropped[f"no fix: {reason}"] += 1
            return None
        return PlaceFixed(
            id=taken.agent_id,
            north_m=solution.north_m,
            east_m=solution.east_m,
            covariance=list(solution.covariance),
            hdop=solution.hdop,
            residual_m=math.sqrt(math.fsum(it * it for it in solution.residuals_m) / used),
            ranges=used,
        )

    def remember(self, taken: RangeTaken) -> None:
        """Stores a range, and drops the ranges that it makes obsolete."""
        kept = [
            it
            for it in self._ranges.get(taken.agent_id, ())
            if it.at_ms >= taken.at_ms - 1000 * self._config.memory_s
            and math.dist((it.north_m, it.east_m), (taken.north_m, taken.east_m)) >= self._config.apart_m
        ]
        self._ranges[taken.agent_id] = [*kept, taken]

    @property
    def ranges(self) -> list[RangeTaken]:
        """All stored ranges, in an order in which they can be stored again."""
        return [taken for ranges in self._ranges.values() for taken in ranges]

    def _solve(
        self, ranges: list[RangeTaken], near_m: tuple[float, float] | None
    ) -> tuple[PlaceSolution, int]:
        if len(ranges) < _AT_LEAST:
            raise NoFix("too few ranges from places apart")
        solution = self._best(ranges, near_m)
        if len(ranges) > _AT_LEAST + 1:
            worst = max(range(len(ranges)), key=lambda n: abs(solution.residuals_m[n]))
            if (solution.residuals_m[worst] / self._config.deviation_m) ** 2 > _GATE:
                ranges = ranges[:worst] + ranges[worst + 1 :]
                solution = self._best(ranges, near_m)
        if solution.hdop > self._config.worst_hdop:
            raise NoFix("the geometry is too flat")
        if solution.chi2 > _GATE * len(ranges):
            raise NoFix("the ranges contradict each other")
        return solution, len(ranges)

    def _best(self, ranges: list[RangeTaken], near_m: tuple[float, float] | None) -> PlaceSolution:
        """The better fit of the two places on either side of the anchors' line."""
        anchors = np.array([(it.north_m, it.east_m, it.depth_m) for it in ranges])
        lengths = np.array([it.range_m for it in ranges])
        deviations = np.full(len(ranges), self._config.deviation_m)
        start = near_m or _beside(anchors, float(lengths.mean()))
        solutions: list[PlaceSolution] = []
        for begin in (start, mirrored(anchors, start)):
            try:
                solutions.append(solve(anchors, lengths, deviations, self._depth_m, begin))
            except NoFix as reason:
                failure = reason
        if not solutions:
            raise failure
        solutions.sort(key=lambda it: it.chi2)
        best, other = solutions[0], solutions[-1]
        apart_m = math.dist((best.north_m, best.east_m), (other.north_m, other.east_m))
        if apart_m > 6 * self._config.deviation_m and other.chi2 - best.chi2 < AMBIGUOUS:
            if near_m is None:
                raise NoFix("the anchors lie on a line, and both its sides fit")
            return min(solutions, key=lambda it: math.dist((it.north_m, it.east_m), near_m))
        return best


def _beside(anchors: Floats, distance_m: float) -> tuple[float, float]:
    """A start for the iteration, off the line through the anchors."""
    centre = anchors[:, :2].mean(axis=0)
    _, _, axes = np.linalg.svd(anchors[:, :2] - centre)
    north, east = centre + distance_m * axes[1]
    return float(north), float(east)
