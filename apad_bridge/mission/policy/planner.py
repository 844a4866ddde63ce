"""The mission's policy: what is due by the beliefs of now, and the plans of its strategies.

Asked if something is due, it changes nothing. A plan goes into the mission's state, and the mission flies it.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import dataclass

from agents.time_scale import MissionMs
from apad_bridge.beliefs.belief import Belief
from apad_bridge.events.mission_events import MissionState
from apad_bridge.mission.end_by import KnownEnd
from apad_bridge.mission.order_book import OrderBook
from apad_bridge.mission.policy.believed_dispatch import (
    NOTHING_DUE,
    BelievedDispatch,
    Docked,
    Due,
    fullest_first,
)
from apad_bridge.mission.policy.charging_watch import ChargingWatch
from apad_bridge.mission.policy.docking_tries import ServiceTries
from apad_bridge.mission.policy.home_places import HomePlaces
from apad_bridge.mission.policy.plan_checks import (
    Planning,
    checked_plan,
    is_refused,
    plan_event,
    without_progress,
)
from apad_bridge.mission.policy.pool import ChargingPool
from apad_bridge.mission.policy.reach import Reach
from apad_bridge.mission.policy.situation import placeholder_belief, situation_of
from apad_bridge.mission.sources import BeliefSource
from apad_bridge.planning.candidates import Situation
from apad_bridge.planning.energy_model import EnergyModel
from apad_bridge.planning.exchange_of_places import exchanges, tour
from apad_bridge.planning.solution import Solution, StepKind
from apad_bridge.planning.strategy import CollectionStrategy, RedeploymentStrategy
from apad_bridge.scenario.blocks.mission_options import Mission
from firmware_model.state_groups import BEYOND_HELP


@dataclass(frozen=True, slots=True)
class PlanRules:
    """The rules by which a mission plans."""

    mission: Mission
    collection: CollectionStrategy
    redeployment: RedeploymentStrategy
    model: EnergyModel | None = None
    """For strategies that look ahead."""
    known_end: KnownEnd | None = None
    """A mission with a known end charges nobody for longer."""


class Planner:
    """Plans for one mission, and knows its pool, its charging, the places, and the tries that failed.

    Each method that asks a strategy raises StrategyFailed.
    """

    def __init__(
        self,
        rules: PlanRules,
        beliefs: BeliefSource,
        book: OrderBook,
        reach: Reach,
        planning: Planning = without_progress,
        barred: Callable[[], frozenset[int]] = frozenset,
    ) -> None:
        """`planning` is entered while a strategy, by its name, plans. `barred` are the aMussels not to be collected now."""
        self._beliefs = beliefs
        self._book = book
        self._reach = reach
        self._planning = planning
        self._barred = barred
        self.charging = ChargingWatch(rules.mission)
        self.tries = ServiceTries(rules.mission, book)
        self.places = HomePlaces(book)
        self.pool = ChargingPool(rules.mission, beliefs)
        self.change(rules)

    def change(self, rules: PlanRules) -> None:
        """Plans by these rules from now on."""
        self._rules = rules
        self._refused = frozenset[int]()
        """The whole pool that the strategy refused last, if it says that it will for a while."""
        self._follow(rules.mission)

    def advance(self, now_ms: MissionMs) -> None:
        """Lowers the thresholds near a known end."""
        if self._rules.known_end is not None:
            self._follow(self._rules_at(now_ms))

    def is_changing(self, now_ms: MissionMs) -> bool:
        """True once the known end makes the pool smaller from tick to tick."""
        known_end = self._rules.known_end
        return known_end is not None and known_end.changes_pool(self._rules.mission, now_ms)

    @property
    def pre_empts(self) -> bool:
        """The rest of a batch is planned anew after each docking."""
        return self._rules.collection.pre_empts

    @property
    def to_release(self) -> dict[int, int]:
        """The dock of each docked aMussel but for those whose dock does not open."""
        kept = self.tries.not_released
        return {agent_id: dock_index for dock_index, agent_id in self._state.docked if agent_id not in kept}

    @property
    def docked(self) -> Docked:
        """The beliefs of those, by id."""
        return {agent_id: self._beliefs.get(agent_id) for agent_id in self.to_release}

    def due(self, docked: Docked, now_ms: MissionMs) -> Due:
        """Decides which of the docked ones to release, or how many to collect; nothing of a pool that is refused still."""
        due = BelievedDispatch(
            self._rules_at(now_ms),
            self.charging,
            docked,
            self._book.docks.count(None),
            lambda: self.candidates(now_ms),
            lambda pool: self.pool.batch_of(pool, self._left_alone),
        ).due(self._reach.beyond.keys())
        if due.released or not due.count or not self._refused.issuperset(it.agent_id for it in due.pool):
            return due
        situation = self._situation(due.pool, now_ms, self._others_than(due.pool))
        return NOTHING_DUE if self._refuses(situation) else due

    def candidates(self, now_ms: MissionMs) -> list[Belief]:
        """The pool without docked aMussels: one that was docked just now was last heard afloat. Empty near a known end."""
        known_end = self._rules.known_end
        if known_end is not None and not known_end.is_worth_a_service(now_ms):
            return []
        pool = self.pool.candidates(now_ms, self._left_alone, self._state.served)
        barred = self._barred()
        return [it for it in pool if not (self._book.is_held(it.agent_id) or it.agent_id in barred)]

    def collect(
        self, pool: Sequence[Belief], batch: int, now_ms: MissionMs, leaving: Collection[int] = ()
    ) -> bool:
        """Asks the strategy for a plan of at most `batch` of the pool; True if there is one now.

        The docked ones that are `leaving` exchange places with them, the fullest first.
        """
        out = fullest_first(self._known(leaving))
        situation = self._situation(pool, now_ms, self._others_than([*pool, *out]), out)
        name = self.config.collection
        with self._planning(name):
            solution = checked_plan(
                name, lambda: self._rules.collection.plan(situation, batch), situation, StepKind.COLLECT
            )
        refuses = not solution.steps and self._refuses(situation)
        self._refused = frozenset(it.agent_id for it in pool if refuses)
        if not solution.steps:
            return False
        flown, pairs = tour(solution, situation), exchanges(solution, situation)
        solution = Solution(tuple(it for it in flown.steps if it.kind is StepKind.COLLECT))
        last_id = solution.steps[-1].agent_id
        last_m = next(it.place_m for it in situation.candidates if it.agent_id == last_id)
        taken = self._take_nearest_places([it.agent_id for it in out[len(pairs) :]], last_m, dict(pairs))
        self._book.emit(
            plan_event(
                "collect",
                name,
                solution,
                situation,
                self.config.costs,
                self._rules.collection,
                exchanged=pairs + taken,
            )
        )
        self._book.set(plan=flown.steps)
        self.places.exchange(pairs)
        return True

    def release(self, agent_ids: Collection[int], now_ms: MissionMs) -> None:
        """Plans to bring the docked aMussels back, in the order of the redeployment strategy.

        Where places are exchanged, each goes to the nearest one that stands empty.
        """
        known = self._known(agent_ids)
        taken = self._take_nearest_places([it.agent_id for it in fullest_first(known)], self._book.here)
        situation = self._situation(known, now_ms)
        name, strategy = self.config.redeployment, self._rules.redeployment
        with self._planning(name):
            solution = checked_plan(name, lambda: strategy.plan(situation), situation, StepKind.DEPLOY)
        self._book.emit(
            plan_event("redeploy", name, solution, situation, self.config.costs, strategy, exchanged=taken)
        )
        self._book.set(plan=solution.steps)

    def settle_places(self) -> None:
        """Ends the exchanges of which one will not be collected any more."""
        self.places.settle(self._is_given_up)

    @property
    def _state(self) -> MissionState:
        return self._book.state

    @property
    def _left_alone(self) -> frozenset[int]:
        """The aMussels whose tries are used up, and those to which the sea bars the way for the present."""
        used_up = self.tries.used_up | self.tries.not_released
        return used_up | self._reach.beyond.keys() if self._reach.beyond else used_up

    def _is_given_up(self, agent_id: int) -> bool:
        belief = self._beliefs.get(agent_id)
        is_lost = belief is not None and belief.state in BEYOND_HELP
        return is_lost or agent_id in self.tries.used_up

    def _rules_at(self, now_ms: MissionMs) -> Mission:
        rules, known_end = self._rules.mission, self._rules.known_end
        return rules if known_end is None else known_end.rules(rules, now_ms)

    def _follow(self, config: Mission) -> None:
        self.config = self.charging.config = self.pool.config = self.tries.config = config
        """The scenario's rules that hold now."""

    def _refuses(self, situation: Situation) -> bool:
        return is_refused(self.config.collection, self._rules.collection, situation)

    def _known(self, agent_ids: Iterable[int]) -> list[Belief]:
        return [self._beliefs.get(it) or placeholder_belief(it, self._book.here) for it in agent_ids]

    def _situation(
        self,
        beliefs: Sequence[Belief],
        now_ms: MissionMs,
        others: Iterable[Belief] = (),
        leaving: Iterable[Belief] = (),
    ) -> Situation:
        sea, model = self._reach.sea(self.config, now_ms), self._rules.model
        return situation_of(
            self._state, self._book.here, beliefs, now_ms, others, model, leaving=leaving, sea=sea
        )

    def _others_than(self, known: Iterable[Belief]) -> list[Belief]:
        """The beliefs about the rest of the fleet that may be served some time; the docked ones too."""
        known_ids = {it.agent_id for it in known}
        return [
            it
            for it in self._beliefs.all()
            if it.agent_id not in known_ids and it.agent_id not in self._left_alone
        ]

    def _take_nearest_places(
        self, leaving: Sequence[int], from_m: tuple[float, float], elsewhere: Collection[int] = ()
    ) -> list[tuple[int, int]]:
        """Gives those that leave the nearest places of the docked ones, if places are exchanged; returns the pairs.

        Those that go `elsewhere` keep theirs, and those to whose places the sea bars the way.
        """
        if not self.config.exchanges_places:
            return []
        return self.places.take_nearest(leaving, from_m, {*elsewhere, *self._reach.beyond})
