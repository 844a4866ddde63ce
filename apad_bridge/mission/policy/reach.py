"""The aMussels to which the sea bars the way for the present, and the place at which the aPad meets one that drifts."""

from __future__ import annotations

from agents.time_scale import MissionMs
from apad_bridge.beliefs.belief import Belief
from apad_bridge.events.mission_events import BeyondReach, InReach
from apad_bridge.mission.order_book import OrderBook
from apad_bridge.mission.policy.home_places import HomePlaces
from apad_bridge.mission.sources import BeliefSource
from apad_bridge.scenario.blocks.mission_options import Mission
from apad_bridge.scenario.hull_in_flow import FlowNow, LegForecast


class Reach:
    def __init__(self, legs: LegForecast | None, book: OrderBook, beliefs: BeliefSource) -> None:
        """With `legs` the mission serves nobody to whom the sea bars the way."""
        self._legs = None if legs is None or legs.is_calm else legs
        self._book = book
        self._beliefs = beliefs
        self.beyond: dict[int, str] = {}
        """The reason, by aMussel to which, or to whose home, the aPad cannot go."""

    def look(self, rules: Mission, now_ms: MissionMs) -> None:
        """Tells of each aMussel that the aPad cannot reach, and when it can again."""
        if self._legs is None:
            return
        homes, beyond = HomePlaces(self._book).all(), {}
        for belief in self._beliefs.all():
            agent_id, place_m = belief.agent_id, (belief.north_m, belief.east_m)
            if self._book.is_held(agent_id):
                reason = self._legs.obstacle(self._book.here, homes.get(agent_id, place_m), now_ms)
            else:
                reason = self._legs.bar_to_float(self._book.here, place_m, rules.speed_m_s, now_ms)
            if reason is not None:
                beyond[agent_id] = reason
        for agent_id in sorted(beyond.keys() - self.beyond.keys()):
            self._book.emit(BeyondReach(agent_id, beyond[agent_id]))
        for agent_id in sorted(self.beyond.keys() - beyond.keys()):
            self._book.emit(InReach(agent_id))
        self.beyond = beyond

    def meeting_m(self, belief: Belief, rules: Mission, now_ms: MissionMs) -> tuple[float, float]:
        """The place at which the aPad meets an aMussel that the sea carries on as soon as it has left the bottom."""
        place_m = belief.north_m, belief.east_m
        if self._legs is None:
            return place_m
        return self._legs.meeting_m(self._book.here, place_m, rules.speed_m_s, now_ms) or place_m

    def sea(self, rules: Mission, now_ms: MissionMs) -> FlowNow | None:
        """The flow for a planner whose costs count it; None in calm water."""
        return None if self._legs is None or not rules.costs.flow else self._legs.at(now_ms, rules.speed_m_s)
