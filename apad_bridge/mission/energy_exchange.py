"""The paper's energy-exchange mission (Fig. 7), from beliefs: wait, collect a batch, charge it, bring it back.

One aPad serves the aMussels of its beliefs. The mission acts when the supervisor calls `advance`, at every
mission tick. Every wait ends: see `Mission` in the scenario for the times, and the journal's notes for the
given-up steps.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import dataclass
from functools import partial
from math import inf

from apad_bridge.beliefs.belief import Belief
from apad_bridge.events.mission import (
    BeyondReach,
    InReach,
    MissionEnd,
    MissionState,
    Phase,
    StandsDown,
    StepGivenUp,
    Stuck,
)
from apad_bridge.events.persons import Steering
from apad_bridge.events.run import EndReason
from apad_bridge.mission.breakdown import Breakdown
from apad_bridge.mission.charging_watch import ChargingWatch
from apad_bridge.mission.dispatch import BelievedDispatch, Docked, fullest_first
from apad_bridge.mission.docking_routine import (
    NOT_FOUND,
    DockingRoutine,
    DockingStep,
    GivenUp,
    OutOfReach,
    Progress,
)
from apad_bridge.mission.end_by import EndBy, KnownEnd
from apad_bridge.mission.home_places import HomePlaces
from apad_bridge.mission.home_stays import NO_HOME, HomeStays
from apad_bridge.mission.order_book import OrderBook
from apad_bridge.mission.orders import Order, TellClear
from apad_bridge.mission.plans import Planning, plan_event, plan_or_reason, refuses_or_reason, untold
from apad_bridge.mission.pool import ChargingPool, floats, placeholder_belief, situation_of
from apad_bridge.mission.service_tries import ServiceTries
from apad_bridge.mission.sink_reminders import SinkReminders
from apad_bridge.mission.sources import BeliefSource
from apad_bridge.planning.candidates import Situation
from apad_bridge.planning.energy_model import EnergyModel
from apad_bridge.planning.exchange import exchanges, tour
from apad_bridge.planning.solution import Solution, Step, StepKind
from apad_bridge.planning.strategy import CollectionStrategy, RedeploymentStrategy
from apad_bridge.scenario.schema import Mission, Places
from apad_bridge.scenario.surface import LegForecast
from apad_bridge.vehicle.commands import GoTo, Hold
from apad_bridge.vehicle.primitives import DockChanged, Outcome, PrimitiveFailed, PrimitiveSucceeded
from firmware_model.state_groups import BEYOND_HELP

STUCK_AFTER = 3
"""So many go-tos that fail in a row are the aPad's fault and not the aMussels'."""
HOME_AGAIN_MS = 10_000
"""A failed way home for good is tried again after so long: the time to be there is near."""
BATTERY_TOLD_AFTER_MS = 10_000
"""A battery that is needed and was not heard for so long is told, once."""
LEGS_PER_STEP = 3
"""A step is given up when its aMussel floats out of reach after so many go-tos."""
DOCKINGS_PER_STEP = 3
"""A step is given up after so many failed dockings, because an aMussel spends most of its charge at the surface."""


@dataclass(frozen=True, slots=True)
class _PhaseBehaviour:
    """The mission's behaviour in a phase, as its methods."""

    begin: _Act
    """Runs when the mission starts in this phase, which may be in the middle of a resumed run."""
    tick: _Act | None = None
    decide: _Decide | None = None
    """Decides, after `tick`, what to do now: an act that is not done yet, or None to wait. It changes nothing.

    These are the boxes of the paper's Fig. 7 that ask something.
    """
    success: _Act | None = None
    """Runs when the phase's primitive has succeeded. A failed primitive gives the step up."""


class EnergyExchange(OrderBook):
    """Has the three verbs; facts are the port's outcomes. `state` is all that a resumed mission needs."""

    def __init__(
        self,
        config: Mission,
        beliefs: BeliefSource,
        collection: CollectionStrategy,
        redeployment: RedeploymentStrategy,
        state: MissionState | None = None,
        model: EnergyModel | None = None,
        home: HomeStays = NO_HOME,
        end_by: EndBy | None = None,
        known_end: KnownEnd | None = None,
        legs: LegForecast | None = None,
        *,
        needs_battery: bool = False,
        planning: Planning = untold,
    ) -> None:
        """`model` is for strategies that look ahead; `home` says when the aPad goes home, `end_by` when for good.

        A mission with a `known_end` charges nobody for longer. With `legs` it serves nobody to whom the sea bars the way.
        One that `needs_battery` does nothing before the aPad's battery was heard: a guard would refuse its go-tos.
        `planning` is entered while a strategy, by its name, plans.
        """
        super().__init__(state or MissionState())
        self._needs_battery = needs_battery
        self._planning = planning
        self._tells_battery_ms: float | None = None
        """The time at which it tells that it waits for the battery; None before it waits."""
        self._model = model
        self._home = home
        self._home_failed_ms: int | None = None
        """The time at which a way home failed; it is not tried again for the silence timeout."""
        self._end_by = end_by
        self._returns = False
        """The time to be home is near: what is docked is brought back as it is, and the aPad goes home."""
        self._rules = config
        """The scenario's rules, of which a known end lowers the thresholds."""
        self._known_end = known_end
        self._config = config
        self._beliefs = beliefs
        self._collection = collection
        self._redeployment = redeployment
        self._charging = ChargingWatch(config)
        self.docking_routine = DockingRoutine(config, beliefs, self, 2 * config.victory_radius_m)
        self._pool = ChargingPool(config, beliefs)
        self._places = HomePlaces(self)
        self._tries = ServiceTries(config, self)
        self._sink_reminders = SinkReminders(round(config.permission_repeat_s * 1000))
        self._breakdown = Breakdown(STUCK_AFTER)
        self._legs = 0
        """Number of go-tos to the aMussel of the step under way."""
        self._dockings = 0
        """Number of failed dockings of the step under way."""
        self._refused = frozenset[int]()
        """The whole pool that the strategy refused last, if it says that it will for a while."""
        self._legs_ahead = None if legs is None or legs.is_calm else legs
        self._beyond_reach: dict[int, str] = {}
        """The reason, by aMussel to which the sea bars the way for the present."""
        self._called_up: set[int] = set()
        """The aMussels that this mission permitted to surface and that have not been docked since."""
        self._must_begin = True
        """The primitive of the state must be ordered: at the start, after a resume, and after a wait for a person."""
        self._awaits_person = False
        """Nothing may move, so nothing is planned, and nothing given up for it."""
        self._began_ms: int | None = None

    @property
    def unheard(self) -> str:
        return super().unheard or ("battery" if self._needs_battery and self.apad_battery is None else "")

    def await_person(self, reason: str, pilot: str = "") -> None:
        """Waits for a person; the step under way begins anew when that one has spoken."""
        if reason and not self._awaits_person:
            self._must_begin, self._began_ms = True, None
        self._awaits_person = bool(reason)

    def receive(self, outcome: Outcome, now_ms: int) -> list[Order]:
        """Takes an outcome of the port; an outcome of a primitive that is not under way changes nothing."""
        leg = self.state.leg
        self.note_outcome(outcome)
        if isinstance(outcome, DockChanged):
            self._called_up.discard(outcome.agent_id)
            self._charging.restart(outcome.agent_id)
            if not outcome.closed:
                self._tries.dock_opened(outcome.agent_id)
            return self.take_orders()
        progress = self.docking_routine.receive(outcome, now_ms)
        if self._awaits_person and not isinstance(outcome, PrimitiveSucceeded):
            return self.take_orders()
        if leg is not None and outcome.primitive_id == leg.primitive_id:
            self._breakdown.go_to_ended(outcome)
        if progress is Progress.GOES_ON:
            self.snapshot()  # a search has legs of its own, which a resume must count
            return self.take_orders()
        if progress is Progress.NOT_FOUND:
            self._dock_again(NOT_FOUND, now_ms)
        elif outcome.primitive_id == self.state.primitive_id:
            if isinstance(outcome, PrimitiveFailed):
                if self.state.phase is Phase.DOCK:
                    self._dock_again(outcome.reason, now_ms)
                elif self.state.plan:
                    self._give_up(outcome.reason, now_ms)
                elif self.state.phase is Phase.GO_HOME:
                    self._home_failed_ms = now_ms
                    self._next_step(now_ms)
            elif self._behaviour.success is not None:
                self._behaviour.success(self, now_ms)
        if (reason := self._breakdown.take()) is not None:
            self.tell(Stuck(reason))
        return self.take_orders()

    def advance(self, now_ms: int) -> list[Order]:
        """Acts on the beliefs at `now_ms`."""
        self._places.learn(self._beliefs.all())
        if self.state.phase is Phase.ENDED:
            return self.take_orders()
        if self.unheard:
            self._tell_unheard_battery(now_ms)
            return self.take_orders()
        if self._awaits_person:
            self._remind_to_sink(now_ms)
            return self.take_orders()
        self._follow_known_end(now_ms)
        if self._must_begin:
            if not self._can_begin(now_ms):
                return self.take_orders()
            self._must_begin = False
            self._behaviour.begin(self, now_ms)
        self._places.settle(self._is_given_up)
        self._look_at_the_sea(now_ms)
        self._look_at_the_time(now_ms)
        behaviour = self._behaviour  # a phase that begins at this tick acts at the next one
        if behaviour.tick is not None:
            behaviour.tick(self, now_ms)
        if behaviour.decide is not None and (act := behaviour.decide(self, now_ms)) is not None:
            act(now_ms)
        self._remind_to_sink(now_ms)
        return self.take_orders()

    def _tell_unheard_battery(self, now_ms: int) -> None:
        """Tells it after a while. That the position is not heard, the supervisor tells."""
        if self.pose is None:
            return
        if self._tells_battery_ms is None:
            self._tells_battery_ms = now_ms + BATTERY_TOLD_AFTER_MS
        elif now_ms >= self._tells_battery_ms:
            self._tells_battery_ms = inf
            self.tell(Stuck("its battery was not heard, and a guard refuses its go-tos until it is"))

    def is_due(self, now_ms: int) -> bool:
        """Tells whether `advance` does something at `now_ms`, by the beliefs and rules of that time. It changes nothing.

        It does not know when a charge stops to rise (`ChargingWatch`), nor how the sea or the time to be home will be. Near
        a known end the pool may shrink from tick to tick, so each is due. Before that the pool's rules do not change.
        """
        if self._must_begin:
            return True
        if self._known_end is not None and self._known_end.changes_pool(self._rules, now_ms):
            return True
        if self._sink_reminders.due(self._beliefs.all(), self._expected, self._called_up, now_ms):
            return True
        if self.state.phase in _COLLECTING:
            return self.docking_routine.is_due(now_ms)
        decide = self._behaviour.decide
        return decide is not None and decide(self, now_ms) is not None

    def change_planning(
        self,
        config: Mission,
        collection: CollectionStrategy,
        redeployment: RedeploymentStrategy,
        model: EnergyModel | None,
        known_end: KnownEnd | None = None,
    ) -> None:
        """Plans, collects and releases by other rules from now on. The plan under way is flown to its end."""
        self._rules, self._known_end = config, known_end
        self._follow(config)
        self._collection, self._redeployment, self._model = collection, redeployment, model
        self._refused = frozenset()

    def stand_down(self, reason: str, now_ms: int) -> list[Order]:
        if self.state.phase not in (Phase.STANDS_DOWN, Phase.ENDED):
            self.tell(StandsDown(reason))
            self.docking_routine.pre_empt()
            self._enter(Phase.STANDS_DOWN, now_ms, plan=())
        return self.take_orders()

    def take_over(self, by: Steering = Steering.PERSON) -> str:
        return "this flight takes no calls: a person cannot take it over"

    def end(self, end: MissionEnd, now_ms: int) -> list[Order]:
        """Ends the mission at once: the aPad holds its position. A second call changes nothing."""
        self._end(end, now_ms)
        return self.take_orders()

    # The phases.

    def _end(self, end: MissionEnd, now_ms: int) -> None:
        if self.state.phase is not Phase.ENDED:
            self.docking_routine.pre_empt()
            self.hold_at_end()
            self.state = self.state.ended(end, now_ms)
            self.snapshot()

    def _can_begin(self, now_ms: int) -> bool:
        """A resumed step waits until its aMussel is heard again, or has been silent for the stated time."""
        if self._began_ms is None:
            self._began_ms = now_ms
        if not self.state.plan or self._beliefs.get(self._step.agent_id) is not None:
            return True
        return now_ms - self._began_ms > self._config.silence_timeout_s * 1000

    def _hold_and_charge(self, now_ms: int) -> None:
        self._hold(now_ms)
        self._charging.begin(self._to_release, now_ms)

    def _resume_collecting(self, now_ms: int) -> None:
        if self._is_held(self._step.agent_id):
            self._finish_step(now_ms)
        else:
            self._go_collect(now_ms)

    def _resume_deploying(self, now_ms: int) -> None:
        if self._is_held(self._step.agent_id):
            self._go_deploy(now_ms)
        else:
            self._finish_step(now_ms)

    def _resume_undocking(self, now_ms: int) -> None:
        """The dock may have opened when no supervisor was there to see it."""
        if self._is_held(self._step.agent_id):
            self._go_deploy(now_ms)
        else:
            self.docking_routine.released(self._step.agent_id)
            self._finish_service(now_ms)

    def _look_at_the_time(self, now_ms: int) -> None:
        """Drops what is not on the way home, once, when no time is left for it. A mechanism that moves is not stopped."""
        end_by, phase = self._end_by, self.state.phase
        if end_by is None or self._returns or phase is Phase.STANDS_DOWN:
            return
        fetched = self._beliefs.get(self._step.agent_id) if phase in _COLLECTING else None
        fetched_m = None if fetched is None else (fetched.north_m, fetched.east_m)
        homes = self._places.all()
        releases_m = [homes.get(it, self._here) for it in self._to_release]
        if not end_by.must_return(now_ms, self._here, releases_m, fetched_m) or phase is Phase.DOCK:
            return
        self._returns = True
        if phase in _COLLECTING:
            self.docking_routine.pre_empt()
        if phase in (*_COLLECTING, Phase.IDLE):
            self.set(plan=())
            self._next_step(now_ms)

    def _look_at_the_sea(self, now_ms: int) -> None:
        """Tells of each aMussel to which, or to whose home, the aPad cannot go, and when it can again."""
        if self._legs_ahead is None:
            return
        homes, held, beyond = self._places.all(), frozenset(dict(self.state.docked).values()), {}
        for belief in self._beliefs.all():
            agent_id, place_m = belief.agent_id, (belief.north_m, belief.east_m)
            if agent_id in held:
                reason = self._legs_ahead.obstacle(self._here, homes.get(agent_id, place_m), now_ms)
            else:
                speed_m_s = self._config.speed_m_s
                reason = self._legs_ahead.bar_to_float(self._here, place_m, speed_m_s, now_ms)
            if reason is not None:
                beyond[agent_id] = reason
        for agent_id in sorted(beyond.keys() - self._beyond_reach.keys()):
            self.tell(BeyondReach(agent_id, beyond[agent_id]))
        for agent_id in sorted(self._beyond_reach.keys() - beyond.keys()):
            self.tell(InReach(agent_id))
        self._beyond_reach = beyond

    def _decide_idle(self, now_ms: int) -> _NextAct | None:
        if self._to_release:
            return self._start_charging  # docked by hand, or before a crash
        if self._is_called_home(now_ms):
            return self._go_home
        return None if self._returns else self._decide_service({}, now_ms)

    def _decide_service(self, docked: Docked, now_ms: int) -> _NextAct | None:
        rules = self._rules_at(now_ms)
        dispatch = BelievedDispatch(
            rules,
            self._charging,
            docked,
            self.docks.count(None),
            lambda: self._candidates(now_ms),
            lambda pool: self._pool.batch_of(pool, self._left_alone),
        )
        released, pool, count = dispatch.due(self._beyond_reach.keys())
        if released:
            return partial(self._exchange_or_release, released, pool, count)
        if not count:
            return None
        if self._refused.issuperset(it.agent_id for it in pool):
            situation = self._situation(pool, {}, now_ms, self._others_than(pool))
            is_refused = refuses_or_reason(self._config.collection, self._collection, situation)
            if isinstance(is_refused, str):
                return partial(self._end, MissionEnd(EndReason.STRATEGY_FAILED, is_refused))
            if is_refused:
                return None
        return partial(self._collect, pool, count)

    def _collect(self, pool: Sequence[Belief], count: int, now_ms: int) -> None:
        if self._plan_collection(pool, count, now_ms):
            self._go_collect(now_ms)

    def _candidates(self, now_ms: int) -> list[Belief]:
        """The pool without docked aMussels: one that was docked just now was last heard afloat. Empty near a known end."""
        if self._known_end is not None and not self._known_end.is_worth_a_service(now_ms):
            return []
        pool = self._pool.candidates(now_ms, self._left_alone, self.state.served)
        return [it for it in pool if not self._is_held(it.agent_id)]

    def _plan_collection(
        self, pool: Sequence[Belief], batch: int, now_ms: int, leaving: Sequence[Belief] = ()
    ) -> bool:
        """Asks the strategy for a plan of at most `batch` of the pool; True if there is one now.

        The docked ones that are `leaving` exchange places with them, in their order.
        """
        situation = self._situation(pool, {}, now_ms, self._others_than([*pool, *leaving]), leaving)
        name = self._config.collection
        with self._planning(name):
            solution = plan_or_reason(
                name, lambda: self._collection.plan(situation, batch), situation, StepKind.COLLECT
            )
        if isinstance(solution, str):
            self._end(MissionEnd(EndReason.STRATEGY_FAILED, solution), now_ms)
            return False
        is_refused = not solution.steps and refuses_or_reason(name, self._collection, situation)
        if isinstance(is_refused, str):
            self._end(MissionEnd(EndReason.STRATEGY_FAILED, is_refused), now_ms)
            return False
        self._refused = frozenset(it.agent_id for it in pool if is_refused)
        if solution.steps:
            flown, pairs = tour(solution, situation), exchanges(solution, situation)
            solution = Solution(tuple(it for it in flown.steps if it.kind is StepKind.COLLECT))
            last_m = next(
                it.place_m for it in situation.candidates if it.agent_id == solution.steps[-1].agent_id
            )
            left = [it.agent_id for it in leaving[len(pairs) :]]
            taken = self._take_nearest_places(left, last_m, dict(pairs))
            self.tell(
                plan_event(
                    "collect", name, solution, situation, self._config.costs, self._collection, pairs + taken
                )
            )
            self.set(plan=flown.steps)
            self._places.exchange(pairs)
        return bool(solution.steps)

    def _take_nearest_places(
        self, leaving: Sequence[int], from_m: tuple[float, float], elsewhere: Collection[int] = ()
    ) -> list[tuple[int, int]]:
        """Gives those that leave the nearest places of the docked ones, if places are exchanged; returns the pairs.

        Those that go `elsewhere` keep theirs, and those to whose places the sea bars the way.
        """
        if self._config.places is not Places.EXCHANGED:
            return []
        return self._places.take_nearest(leaving, from_m, {*elsewhere, *self._beyond_reach})

    def _is_given_up(self, agent_id: int) -> bool:
        """The aMussel will not be collected any more."""
        belief = self._beliefs.get(agent_id)
        is_lost = belief is not None and belief.state in BEYOND_HELP
        return is_lost or agent_id in self._tries.used_up

    def _go_collect(self, now_ms: int) -> None:
        step, belief = self._step, self._beliefs.get(self._step.agent_id)
        if step.agent_id in self._beyond_reach:
            self._finish_step(now_ms)
            return
        if belief is None:
            self._give_up("it never reported", now_ms)
            return
        if self.docks[step.dock_index] is not None:
            # The dock was to be empty by now, and did not open.
            if None not in self.docks:
                self.tell(StepGivenUp(step.agent_id, step.kind.value, "no dock is free"))
                self._finish_step(now_ms)
                return
            step = step._replace(dock_index=self.docks.index(None))
            self.set(plan=(step, *self.state.plan[1:]))
        self._legs, self._dockings = 1, 0
        self._go_to(*self._meeting_m(belief, now_ms))
        self._called_up.add(belief.agent_id)
        self.docking_routine.call_up(belief.agent_id, now_ms)
        self._enter(Phase.GO_COLLECT, now_ms)

    def _repeat_permission(self, now_ms: int) -> None:
        self.docking_routine.advance(self._here, now_ms)

    def _watch_surfacing(self, now_ms: int) -> None:
        try:
            step = self.docking_routine.advance(self._here, now_ms)
        except OutOfReach:
            self._go_again(now_ms)
        except GivenUp as given_up:
            self._give_up(str(given_up), now_ms)
        else:
            if step is DockingStep.CLOSE:
                self._enter(Phase.DOCK, now_ms)

    def _go_again(self, now_ms: int) -> None:
        """Goes after an aMussel that floats out of reach, for the water has carried it on."""
        belief = self._beliefs.get(self._step.agent_id)
        assert belief is not None
        if self._legs >= LEGS_PER_STEP:
            self._give_up(f"it still floats out of reach after {self._legs} go-tos", now_ms)
            return
        self._legs += 1
        self._go_to(*self._meeting_m(belief, now_ms))
        self._enter(Phase.GO_COLLECT, now_ms)

    def _dock_again(self, reason: str, now_ms: int) -> None:
        """Tries a failed docking again at once; an aMussel that no longer floats is permitted to surface again."""
        self._dockings += 1
        if self._dockings < DOCKINGS_PER_STEP:
            self._await_surfacing(now_ms)
        else:
            self._give_up(reason, now_ms)

    def _start_charging(self, now_ms: int) -> None:
        self._hold_and_charge(now_ms)
        self._enter(Phase.CHARGE, now_ms, plan=())

    def _watch_charging(self, now_ms: int) -> None:
        for agent_id, reason in self._charging.give_up_stalled(self._docked, now_ms):
            self.tell(StepGivenUp(agent_id, "charge", reason))

    def _decide_release(self, now_ms: int) -> _NextAct | None:
        docked = self._docked
        if not docked:
            return self._idle
        if self._returns or self._is_called_home(now_ms):
            if self._returns or self._home.releases_first:
                return partial(self._release, tuple(docked))
            return self._go_home
        return self._decide_service(docked, now_ms)

    def _exchange_or_release(
        self, released: Collection[int], pool: Sequence[Belief], count: int, now_ms: int
    ) -> None:
        if not self._exchange(released, pool, count, now_ms):
            self._release(released, now_ms)

    def _exchange(self, released: Collection[int], pool: Sequence[Belief], count: int, now_ms: int) -> bool:
        """Has the docked aMussels take the places of others that are collected on the same tour; False if none is."""
        if not count:
            return False
        known = [self._beliefs.get(it) or placeholder_belief(it, self._here) for it in released]
        is_planned = self._plan_collection(pool, count, now_ms, fullest_first(known))
        if is_planned:
            self._next_step(now_ms)
        return is_planned or self.state.phase is Phase.ENDED

    def _release(self, agent_ids: Collection[int], now_ms: int) -> None:
        """Has the docked aMussels brought back, in the order of the redeployment strategy.

        Where places are exchanged, each goes to the nearest one that stands empty.
        """
        known = [self._beliefs.get(it) or placeholder_belief(it, self._here) for it in agent_ids]
        taken = self._take_nearest_places([it.agent_id for it in fullest_first(known)], self._here)
        situation = self._situation(known, self._to_release, now_ms)
        name = self._config.redeployment
        with self._planning(name):
            solution = plan_or_reason(
                name, lambda: self._redeployment.plan(situation), situation, StepKind.DEPLOY
            )
        if isinstance(solution, str):
            self._end(MissionEnd(EndReason.STRATEGY_FAILED, solution), now_ms)
            return
        self.tell(
            plan_event("redeploy", name, solution, situation, self._config.costs, self._redeployment, taken)
        )
        self.set(plan=solution.steps)
        self._next_step(now_ms)

    def _is_called_home(self, now_ms: int) -> bool:
        failed_ms = self._home_failed_ms
        patience_ms = HOME_AGAIN_MS if self._returns else self._config.silence_timeout_s * 1000
        if failed_ms is not None and now_ms - failed_ms <= patience_ms:
            return False
        return self._returns or self._home.must_go(now_ms, self.apad_battery)

    def _go_home(self, now_ms: int) -> None:
        self._go_to(*self._home.place_m)
        self._enter(Phase.GO_HOME, now_ms, plan=())

    def _stay_at_home(self, now_ms: int) -> None:
        self._home_failed_ms = None
        if self._returns:
            self._end(MissionEnd(EndReason.END_BY), now_ms)
            return
        self._hold(now_ms)
        self._enter(Phase.AT_HOME, now_ms)

    def _decide_at_home(self, now_ms: int) -> _NextAct | None:
        leaves = self._returns or self._home.may_leave(now_ms, self.apad_battery)
        return self._next_step if leaves else None

    def _go_deploy(self, now_ms: int) -> None:
        if self._step.agent_id in self._beyond_reach:
            self._finish_step(now_ms)
            return
        north_m, east_m = self._places.all().get(self._step.agent_id, self._here)
        self._go_to(north_m, east_m)
        self._enter(Phase.GO_DEPLOY, now_ms)

    def _idle(self, now_ms: int) -> None:
        self._hold(now_ms)
        self._enter(Phase.IDLE, now_ms, plan=())

    def _await_surfacing(self, now_ms: int) -> None:
        self.docking_routine.dock(self._step.dock_index, self._step.agent_id, now_ms)
        self._enter(Phase.AWAIT_SURFACING, now_ms)

    def _undock(self, now_ms: int) -> None:
        self.docking_routine.undock(self._step.dock_index, self._step.agent_id)
        self._enter(Phase.UNDOCK, now_ms)

    def _finish_service(self, now_ms: int) -> None:
        """Ends a release. A try has helped when the aMussel leaves with a charge above the pool's threshold."""
        agent_id = self._step.agent_id
        self.set(released=tuple(sorted({**dict(self.state.released), agent_id: now_ms}.items())))
        belief = self._beliefs.get(agent_id)
        if belief is None or self._pool.is_low(belief):
            self._tries.service_failed(agent_id, "it left its dock with too little charge")
        else:
            self._tries.service_helped(agent_id)
        self._finish_step(now_ms)

    def _give_up(self, reason: str, now_ms: int) -> None:
        step = self._step
        if step.kind is StepKind.COLLECT and self._breakdown.failed <= 1:
            # Of go-tos that fail in a row only the first may be the aMussel's fault.
            self._tries.service_failed(step.agent_id, reason)
        elif self.state.phase is Phase.UNDOCK:
            self._charging.restart(step.agent_id)
            self._tries.undocking_failed(step.agent_id, reason)
        self.tell(StepGivenUp(step.agent_id, step.kind.value, reason))
        is_beside_it = self.state.phase in (Phase.AWAIT_SURFACING, Phase.DOCK)
        if not (is_beside_it and self._floats(step.agent_id)):
            # One that floats is a candidate again at once; a go-to that failed would only fail again.
            self._pool.exclude(step.agent_id, now_ms)
        self._finish_step(now_ms)

    def _finish_step(self, now_ms: int) -> None:
        finished, left = self._step, self.state.plan[1:]
        self.set(plan=left)
        collects = finished.kind is StepKind.COLLECT and all(it.kind is StepKind.COLLECT for it in left)
        if collects and left and self._collection.pre_empts:
            self._plan_rest_of_batch(len(left), now_ms)
        self._places.settle(self._is_given_up)
        if self.state.phase is not Phase.ENDED:
            self._next_step(now_ms)

    def _plan_rest_of_batch(self, count: int, now_ms: int) -> None:
        """Chooses the aMussels for the docks that are left anew, from the pool as it is now."""
        pool = self._candidates(now_ms)
        if pool:
            self._plan_collection(pool, count, now_ms)

    def _next_step(self, now_ms: int) -> None:
        if not self.state.plan:
            # Docks that could not be opened are charged and tried again, so often as `collection_attempts` says.
            if self._to_release:
                self._start_charging(now_ms)
            else:
                self._idle(now_ms)
        elif self._step.kind is StepKind.COLLECT:
            self._go_collect(now_ms)
        else:
            self._go_deploy(now_ms)

    # Helpers.

    def _follow_known_end(self, now_ms: int) -> None:
        if self._known_end is not None:
            self._follow(self._rules_at(now_ms))

    def _rules_at(self, now_ms: int) -> Mission:
        return self._rules if self._known_end is None else self._known_end.rules(self._rules, now_ms)

    def _follow(self, config: Mission) -> None:
        self._config = self._charging.config = self._pool.config = self._tries.config = config
        self.docking_routine.config = config

    @property
    def _behaviour(self) -> _PhaseBehaviour:
        return _BEHAVIOURS[self.state.phase]

    @property
    def _left_alone(self) -> frozenset[int]:
        """The aMussels whose tries are used up, and those to which the sea bars the way for the present."""
        used_up = self._tries.used_up | self._tries.not_released
        return used_up | self._beyond_reach.keys() if self._beyond_reach else used_up

    @property
    def _to_release(self) -> dict[int, int]:
        """The dock of each docked aMussel but for those whose dock does not open."""
        kept = self._tries.not_released
        return {agent_id: dock_index for dock_index, agent_id in self.state.docked if agent_id not in kept}

    @property
    def _docked(self) -> Docked:
        """The beliefs of those, by id."""
        return {agent_id: self._beliefs.get(agent_id) for agent_id in self._to_release}

    @property
    def _here(self) -> tuple[float, float]:
        assert self.pose is not None  # nothing is done before it is known
        return self.pose

    def _floats(self, agent_id: int) -> bool:
        belief = self._beliefs.get(agent_id)
        return belief is not None and floats(belief)

    def _is_held(self, agent_id: int) -> bool:
        return agent_id in dict(self.state.docked).values()

    @property
    def _step(self) -> Step:
        return self.state.plan[0]

    def _situation(
        self,
        beliefs: Sequence[Belief],
        docks: dict[int, int],
        now_ms: int,
        others: Iterable[Belief] = (),
        leaving: Iterable[Belief] = (),
    ) -> Situation:
        rules, legs = self._config, self._legs_ahead
        sea = legs.at(now_ms, rules.speed_m_s) if legs is not None and rules.costs.flow else None
        return situation_of(self.state, self._here, beliefs, docks, now_ms, others, self._model, leaving, sea)

    def _others_than(self, known: Iterable[Belief]) -> list[Belief]:
        """The beliefs about the rest of the fleet that may be served some time; the docked ones too."""
        known_ids = {it.agent_id for it in known}
        return [
            it
            for it in self._beliefs.all()
            if it.agent_id not in known_ids and it.agent_id not in self._left_alone
        ]

    def _remind_to_sink(self, now_ms: int) -> None:
        for agent_id in self._sink_reminders.take_due(
            self._beliefs.all(), self._expected, self._called_up, now_ms
        ):
            self.order(TellClear(agent_id))

    @property
    def _expected(self) -> set[int]:
        """The aMussels of the plan and of the docks, which need no reminder to sink."""
        return {step.agent_id for step in self.state.plan} | set(dict(self.state.docked).values())

    def _go_to(self, north_m: float, east_m: float) -> None:
        config = self._config
        self.order(GoTo(self.next_id(), north_m, east_m, config.speed_m_s, config.victory_radius_m))

    def _meeting_m(self, belief: Belief, now_ms: int) -> tuple[float, float]:
        """The place at which the aPad meets an aMussel that the sea carries on as soon as it has left the bottom."""
        place_m = belief.north_m, belief.east_m
        if self._legs_ahead is None:
            return place_m
        return self._legs_ahead.meeting_m(self._here, place_m, self._config.speed_m_s, now_ms) or place_m

    def _hold(self, now_ms: int) -> None:
        if self.pose is not None:
            self.order(Hold(self.next_id(), *self.pose))

    def _enter(self, phase: Phase, now_ms: int, **changes: object) -> None:
        self.set(phase=phase, since_ms=now_ms, **changes)
        self.snapshot()


def _nothing(mission: EnergyExchange, now_ms: int) -> None:
    pass


_COLLECTING = (Phase.GO_COLLECT, Phase.AWAIT_SURFACING)
_Act = Callable[[EnergyExchange, int], None]
_NextAct = Callable[[int], None]
"""An act that is called with the time at which it is done."""
_Decide = Callable[[EnergyExchange, int], _NextAct | None]
_M = EnergyExchange
_BEHAVIOURS = {
    Phase.IDLE: _PhaseBehaviour(_M._hold, decide=_M._decide_idle),
    Phase.GO_COLLECT: _PhaseBehaviour(
        _M._resume_collecting, tick=_M._repeat_permission, success=_M._await_surfacing
    ),
    Phase.AWAIT_SURFACING: _PhaseBehaviour(_M._resume_collecting, tick=_M._watch_surfacing),
    Phase.DOCK: _PhaseBehaviour(_M._resume_collecting, success=_M._finish_step),
    Phase.CHARGE: _PhaseBehaviour(_M._hold_and_charge, tick=_M._watch_charging, decide=_M._decide_release),
    Phase.GO_DEPLOY: _PhaseBehaviour(_M._resume_deploying, success=_M._undock),
    Phase.UNDOCK: _PhaseBehaviour(_M._resume_undocking, success=_M._finish_service),
    Phase.GO_HOME: _PhaseBehaviour(_M._go_home, success=_M._stay_at_home),
    Phase.AT_HOME: _PhaseBehaviour(_M._go_home, decide=_M._decide_at_home),
    Phase.STANDS_DOWN: _PhaseBehaviour(_nothing),
    Phase.ENDED: _PhaseBehaviour(_nothing),
    Phase.COMMANDED: _PhaseBehaviour(_nothing),
}
"""The behaviour in each box of the paper's Fig. 7."""
