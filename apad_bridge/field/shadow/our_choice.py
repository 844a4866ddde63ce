"""Our choice at a decision of theirs: the first step of our plan as long as they follow it, else of a new plan."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from agents.time_scale import MissionMs
from apad_bridge.assembly.scenario_energy_model import energy_model
from apad_bridge.beliefs.belief import Belief
from apad_bridge.beliefs.fleet_beliefs import FleetBeliefs
from apad_bridge.events.mission_events import MissionState
from apad_bridge.field.field_log.log_facts import Place
from apad_bridge.field.shadow.compared import WAIT, TheirMove
from apad_bridge.mission.policy.believed_dispatch import BelievedDispatch, fullest_first
from apad_bridge.mission.policy.charging_watch import ChargingWatch
from apad_bridge.mission.policy.plan_checks import checked_plan
from apad_bridge.mission.policy.pool import ChargingPool
from apad_bridge.mission.policy.situation import placeholder_belief, situation_of
from apad_bridge.planning import registry
from apad_bridge.planning.candidates import Situation
from apad_bridge.planning.exchange_of_places import tour
from apad_bridge.planning.solution import Step, StepKind
from apad_bridge.scenario.hull_in_flow import LegForecast, surface_of
from apad_bridge.scenario.schema import Scenario


@dataclass(frozen=True, slots=True)
class Moment:
    """Our knowledge of their mission when they decide."""

    now_ms: MissionMs
    state: MissionState
    place_m: Place | None
    """The aPad's; None before it was told."""
    in_batch: bool
    """Their last decision was to collect: the batch is under way."""


class OurChoice:
    """The scenario's mission with its strategies, and the rest of its plan."""

    def __init__(self, scenario: Scenario, beliefs: FleetBeliefs, trust: registry.Trust | None) -> None:
        """ValueError for a strategy that cannot be loaded. One in a file is executed with `trust` alone."""
        mission = scenario.mission
        self.charging = ChargingWatch(mission)
        self._mission = mission
        self._beliefs = beliefs
        self._collection = registry.collection(mission.collection, mission.costs, trust)
        self._redeployment = registry.redeployment(mission.redeployment, trust)
        self._model = energy_model(scenario)
        self._legs = LegForecast(scenario.apad, surface_of(scenario))
        self._pool = ChargingPool(mission, beliefs)
        self._plan: tuple[Step, ...] = ()

    def move(self, at: Moment) -> TheirMove:
        if not self._plan and at.place_m is not None:
            self._plan = self._planned(at, at.place_m)
        return TheirMove(WAIT) if not self._plan else TheirMove(self._plan[0].kind, self._plan[0].agent_id)

    def compare(self, theirs: TheirMove, ours: TheirMove) -> None:
        """Goes on with our plan if they did its next step; else the next choice is planned anew."""
        self._plan = self._plan[1:] if theirs == ours else ()

    def forget(self) -> None:
        """The next choice is planned anew."""
        self._plan = ()

    def _planned(self, at: Moment, place_m: Place) -> tuple[Step, ...]:
        state, held = at.state, {agent_id for _, agent_id in at.state.docked}
        docked = {agent_id: self._beliefs.get(agent_id) for agent_id in held}
        candidates = self._pool.candidates(at.now_ms, served=state.served)
        pool = [it for it in candidates if it.agent_id not in held]
        free = state.dock_count - len(held)
        due = BelievedDispatch(
            self._mission, self.charging, docked, free, lambda: pool, self._pool.batch_of
        ).due(kept=())
        count = due.count
        if due.released:
            known = [docked[it] or placeholder_belief(it, place_m) for it in due.released]
            if count:
                return self._collection_steps(at, place_m, due.pool, count, fullest_first(known))
            others = [it for it in self._beliefs.all() if it.agent_id not in due.released]
            situation = self._situation(at, place_m, known, others)
            return checked_plan(
                self._mission.redeployment,
                lambda: self._redeployment.plan(situation),
                situation,
                StepKind.DEPLOY,
            ).steps
        if held and at.in_batch and not self._mission.is_asynchronous:
            # Their batch is under way, and we have another opinion of its rest.
            count = min(self._mission.batch - len(held), len(pool), free)
        return self._collection_steps(at, place_m, pool, count) if count > 0 else ()

    def _situation(
        self,
        at: Moment,
        place_m: Place,
        beliefs: Iterable[Belief],
        others: Iterable[Belief],
        leaving: Iterable[Belief] = (),
    ) -> Situation:
        rules = self._mission
        sea = self._legs.at(at.now_ms, rules.speed_m_s) if rules.costs.flow else None
        return situation_of(
            at.state, place_m, beliefs, at.now_ms, others, self._model, leaving=leaving, sea=sea
        )

    def _collection_steps(
        self, at: Moment, place_m: Place, pool: Sequence[Belief], count: int, leaving: Sequence[Belief] = ()
    ) -> tuple[Step, ...]:
        """The steps of a collection of `count` of the pool; docked ones that are `leaving` exchange places with them."""
        known = {it.agent_id for it in (*pool, *leaving)}
        others = [it for it in self._beliefs.all() if it.agent_id not in known]
        situation = self._situation(at, place_m, pool, others, leaving)
        solution = checked_plan(
            self._mission.collection,
            lambda: self._collection.plan(situation, count),
            situation,
            StepKind.COLLECT,
        )
        return tour(solution, situation).steps
