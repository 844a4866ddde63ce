"""All that an aPad does by sound beside its mission: plans what it says, and turns answered pings into places."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence

from apad_bridge.beliefs.belief import Belief
from apad_bridge.beliefs.fleet import FleetBeliefs
from apad_bridge.beliefs.measurement import Fixed, Ranged
from apad_bridge.beliefs.pings import PingPolicy, to_ping
from apad_bridge.facts import RangeHeard, SupervisorAction
from apad_bridge.localisation.locator import Locator, PositionFix, RangeTaken
from apad_bridge.mission.orders import Note
from apad_bridge.talking.talk import Talk
from apad_bridge.vehicle import PoseReported
from firmware_model.state_groups import DOCKED, UP_AND_UNDOCKED

_AWAY = DOCKED | UP_AND_UNDOCKED


class Ears:
    """Owned by the supervisor, which calls it at ticks."""

    def __init__(
        self,
        talk: Talk,
        locator: Locator | None,
        keel_m: float,
        depth_m: float,
        deviation_m: float,
        asks: PingPolicy | None = None,
    ) -> None:
        """`deviation_m`: of a range. Without a `locator` pings tell ways, and no places.

        `asks` says who is pinged because too little is known of it.
        """
        self._asks = asks
        self._talk = talk
        self._locator = locator
        self._keel_m = keel_m
        self._depth_m = depth_m
        self._deviation_m = deviation_m

    @property
    def dropped(self) -> Counter[str]:
        return Counter() if self._locator is None else self._locator.dropped

    def advance(self, beliefs: Sequence[Belief], now_ms: int) -> list[SupervisorAction]:
        away = frozenset(it.agent_id for it in beliefs if it.state in _AWAY)
        if self._asks is None:
            return self._talk.advance(now_ms, away)
        near = [it for it in beliefs if it.agent_id not in away]
        return self._talk.advance(now_ms, away, to_ping(self._asks, near, now_ms, at_most=1))

    def timed(self, actions: Sequence[SupervisorAction], now_ms: int) -> list[SupervisorAction]:
        return self._talk.timed(actions, now_ms)

    def moved(self, agent_id: int, now_ms: int) -> None:
        """A dock closed around it or let it go."""
        self._talk.moved(agent_id, now_ms)
        if self._locator is not None:
            self._locator.forget(agent_id)

    def hear(
        self, fact: RangeHeard, pose: PoseReported | None, beliefs: FleetBeliefs, now_ms: int
    ) -> list[SupervisorAction]:
        """What a ping's outcome means: perhaps a slot, and perhaps a place, of which `beliefs` learn."""
        if fact.range_m is None:
            return []
        actions = self._talk.hear(fact.agent_id, fact.range_m, now_ms)
        if self._locator is None or pose is None:
            return actions
        taken = RangeTaken(fact.at_ms, fact.agent_id, fact.range_m, pose.north_m, pose.east_m, self._keel_m)
        belief = beliefs.get(fact.agent_id)
        fix = self._locator.take(taken, None if belief is None else (belief.north_m, belief.east_m))
        if fix is None:
            self._learn_range(taken, beliefs)
            return actions
        variance_m2 = (fix.covariance[0] + fix.covariance[2]) / 2
        beliefs.learn(fix.agent_id, Fixed(fix.at_ms, fix.north_m, fix.east_m, variance_m2))
        return [*actions, Note("fix", fix_data(fix))]

    def _learn_range(self, taken: RangeTaken, beliefs: FleetBeliefs) -> None:
        down_m = self._depth_m - self._keel_m
        along_m = math.sqrt(max(0.0, taken.range_m**2 - down_m**2))
        ranged = Ranged(taken.at_ms, along_m, taken.north_m, taken.east_m, self._deviation_m**2)
        beliefs.learn(taken.agent_id, ranged)


def fix_data(fix: PositionFix) -> dict[str, object]:
    """As the journal keeps it; metres and square metres."""
    return {
        "id": fix.agent_id,
        "north_m": round(fix.north_m, 3),
        "east_m": round(fix.east_m, 3),
        "covariance": [round(it, 6) for it in fix.covariance],
        "hdop": round(fix.hdop, 3),
        "residual_m": round(fix.residual_m, 4),
        "ranges": fix.ranges,
    }
