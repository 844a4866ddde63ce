"""Rules of a mission that knows its end: the charge that lasts until then, and the time that the way home still takes."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

from agents.time_scale import MissionMs
from apad_bridge.scenario.blocks.mission_options import Mission
from apad_bridge.scenario.hull_in_flow import FlowNow, LegForecast

Point = tuple[float, float]
SLOWER = 0.8
"""The share of its ordered speed that an aPad makes good: it starts, brakes, and meets currents that nobody told."""
MARGIN_S = 60.0
"""For what was not foreseen."""
LEAST_SERVICE = 0.2
"""A service for less charge than this is taken as not worth its way."""


@dataclass(frozen=True, slots=True)
class EndBy:
    """`deadline_s` is of mission time, `undock_s` the longest that an undocking and `dock_s` that a docking takes."""

    deadline_s: float
    home_m: Point
    speed_m_s: float
    dock_s: float
    undock_s: float
    legs: LegForecast | None = None
    """The known sea, in which a leg may take longer; None in calm water."""

    def must_return(
        self, now_ms: MissionMs, here_m: Point, releases_m: Iterable[Point], fetched_m: Point | None = None
    ) -> bool:
        """True when no time is left but for bringing the docked aMussels to `releases_m`, and the way home.

        `fetched_m` is the place of the aMussel that the aPad is fetching, to which it is brought back too.
        """
        needed_s, from_m, rest = MARGIN_S, here_m, list(releases_m)
        sea = None if self.legs is None else self.legs.at(now_ms, self.speed_m_s)
        if fetched_m is not None:
            needed_s += self._way_s(from_m, fetched_m, sea) + self.dock_s
            from_m = fetched_m
            rest.append(fetched_m)
        # The order of the strategy may be better, and is not worse by much than the nearest first.
        while rest:
            nearest_m = min(rest, key=lambda it: math.dist(from_m, it))
            rest.remove(nearest_m)
            needed_s += self._way_s(from_m, nearest_m, sea) + self.undock_s
            from_m = nearest_m
        needed_s += self._way_s(from_m, self.home_m, sea)
        return now_ms / 1000 + needed_s >= self.deadline_s

    def _way_s(self, from_m: Point, to_m: Point, sea: FlowNow | None) -> float:
        if sea is not None:
            return sea.seconds(from_m, to_m) / SLOWER
        return math.dist(from_m, to_m) / (SLOWER * self.speed_m_s)


@dataclass(frozen=True, slots=True)
class KnownEnd:
    """`end_s` is of mission time, and `drain_per_s` the charge that an aMussel at work spends in a second of it."""

    end_s: float
    drain_per_s: float

    def lasting_charge(self, now_ms: MissionMs) -> float:
        """The charge with which an aMussel works from now until the end."""
        return max(0.0, self.drain_per_s * (self.end_s - now_ms / 1000))

    def is_worth_a_service(self, now_ms: MissionMs) -> bool:
        return self.lasting_charge(now_ms) >= LEAST_SERVICE

    def changes_pool(self, rules: Mission, now_ms: MissionMs) -> bool:
        """True once fewer aMussels may be in the pool than by these rules: near the end."""
        most = self.lasting_charge(now_ms)
        return most < max(LEAST_SERVICE, rules.pool_threshold, rules.again_threshold or 0.0)

    def rules(self, rules: Mission, now_ms: MissionMs) -> Mission:
        """The mission's rules with no threshold above the charge that lasts."""
        most = self.lasting_charge(now_ms)
        return rules if most >= 1.0 else rules.at_most(most)
