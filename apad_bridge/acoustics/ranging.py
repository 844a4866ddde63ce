"""All that an aPad does by sound beside its mission: plans what it says, and turns answered pings into places."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import astuple
from typing import Any

from apad_bridge.acoustics.locator import Locator, PositionFix, RangeTaken
from apad_bridge.acoustics.schedule import AcousticScheduler
from apad_bridge.beliefs import modes
from apad_bridge.beliefs.belief import Belief
from apad_bridge.beliefs.fleet import FleetBeliefs
from apad_bridge.beliefs.measurement import Fixed, Ranged
from apad_bridge.beliefs.modes import Mode
from apad_bridge.beliefs.pings import PingPolicy, to_ping
from apad_bridge.mission.events import RangeHeard, SupervisorAction
from apad_bridge.mission.orders import Note
from apad_bridge.vehicle.commands import PoseReported
from firmware_model.state_groups import DOCKED, UP_AND_UNDOCKED

_AWAY = DOCKED | UP_AND_UNDOCKED


class RangingService:
    """Owned by the supervisor, which calls it at ticks."""

    def __init__(
        self,
        talk: AcousticScheduler,
        locator: Locator | None,
        keel_m: float,
        depth_m: float,
        deviation_m: float,
        places: PingPolicy | None = None,
        charges: PingPolicy | None = None,
    ) -> None:
        """`deviation_m`: of a range. Without a `locator` pings tell ways, and no places.

        `places` says whose range is taken because too little is known of where it is, `charges` who is asked how it is.
        """
        self._places = places
        self._charges = charges
        self._talk = talk
        self._locator = locator
        self._keel_m = keel_m
        self._depth_m = depth_m
        self._deviation_m = deviation_m
        self._rows: list[tuple[Any, ...]] = []
        """Since it was asked last: ranges, and, alone in its row, who was moved."""
        self._told_talk: dict[str, Any] = talk.kept()

    @property
    def dropped(self) -> Counter[str]:
        told = Counter() if self._locator is None else self._locator.dropped.copy()
        if self._talk.unanswered:
            told["sound: asked how it was, and no answer came in time"] = self._talk.unanswered
        return told

    def kept(self) -> dict[str, Any]:
        """All that was learned, as plain data; `news` are what comes after it."""
        self._rows, self._told_talk = [], self._talk.kept()
        ranges = [] if self._locator is None else [astuple(it) for it in self._locator.ranges]
        return {"talk": self._told_talk, "ranges": ranges}

    def news(self) -> dict[str, Any] | None:
        """What was learned since `kept` or `news` was asked last; None for nothing."""
        talk = self._talk.kept()
        if talk == self._told_talk and not self._rows:
            return None
        rows, self._rows, self._told_talk = self._rows, [], talk
        return {"talk": talk, "rows": rows}

    def restore(self, kept: dict[str, Any]) -> None:
        """Knows what another's `kept` said; KeyError, TypeError or ValueError for anything else."""
        self._talk.restore(kept["talk"])
        self.take_news({"talk": kept["talk"], "rows": kept["ranges"]})

    def take_news(self, news: dict[str, Any]) -> None:
        """As another's `news` told it."""
        self._talk.restore(news["talk"])
        for row in news["rows"]:
            if self._locator is None:
                continue
            if len(row) == 1:
                self._locator.forget(*row)
            else:
                self._locator.remember(RangeTaken(*row))

    def advance(self, beliefs: Sequence[Belief], now_ms: int) -> list[SupervisorAction]:
        away = frozenset(it.agent_id for it in beliefs if _is_away(it))
        near = [it for it in beliefs if it.agent_id not in away]
        whereabouts, charges = (
            [] if policy is None else to_ping(policy, near, now_ms)
            for policy in (self._places, self._charges)
        )
        return self._talk.advance(now_ms, away, whereabouts, charges)

    def heard_of(self, agent_id: int) -> None:
        """It said in short how it is, whether it was asked or not."""
        self._talk.heard_of(agent_id)

    def timed(self, actions: Sequence[SupervisorAction], now_ms: int) -> list[SupervisorAction]:
        return self._talk.timed(actions, now_ms)

    def moved(self, agent_id: int, now_ms: int) -> None:
        """A dock closed around it or let it go."""
        self._talk.moved(agent_id, now_ms)
        if self._locator is not None:
            self._locator.forget(agent_id)
            self._rows.append((agent_id,))

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
        self._rows.append(astuple(taken))
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


def _is_away(belief: Belief) -> bool:
    """In a dock or afloat, and so deaf; of a belief that goes on by itself, more probably so than not."""
    if belief.is_carried:
        return belief.probability_of(*modes.DOCKED, Mode.FLOATING) > 0.5
    return belief.state in _AWAY


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
