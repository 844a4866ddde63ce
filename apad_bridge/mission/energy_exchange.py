"""The paper's energy-exchange mission (Fig. 7): wait, collect a batch, charge it full, bring it back. Built from beliefs.

One aPad serves the aMussels it believes in. It acts when `advance` is called, which the supervisor does at every mission
tick. Every wait ends: see `Mission` in the scenario for the times, and the notes that say what was given up.
"""

from __future__ import annotations

import math
from dataclasses import replace

from apad_bridge.beliefs.belief import Belief
from apad_bridge.mission.charging_watch import ChargingWatch
from apad_bridge.mission.homes import with_new_homes
from apad_bridge.mission.orders import Note, Order, PermitSurfacing, TellClear
from apad_bridge.mission.plans import asked, plan_note
from apad_bridge.mission.pool import SLOTS, ChargingPool, situation_of, unheard
from apad_bridge.mission.sources import BeliefSource
from apad_bridge.mission.state import MissionState, Phase
from apad_bridge.mission.strays import Strays
from apad_bridge.planning.candidates import Situation
from apad_bridge.planning.solution import Solution, Step, StepKind
from apad_bridge.planning.strategy import CollectionStrategy, RedeploymentStrategy
from apad_bridge.port.primitives import (
    DockChanged,
    DockMussel,
    GoToPoint,
    HoldPosition,
    Outcome,
    PrimitiveFailed,
    PrimitiveSucceeded,
    UndockMussel,
)
from apad_bridge.scenario.schema import Mission
from firmware_model.states import State


class EnergyExchange:
    """Three verbs in mission time; facts are the port's outcomes. `state` is all that a resumed mission needs."""

    def __init__(
        self,
        config: Mission,
        beliefs: BeliefSource,
        collection: CollectionStrategy,
        redeployment: RedeploymentStrategy,
        state: MissionState | None = None,
    ) -> None:
        self.state = state or MissionState()
        self._config = config
        self._beliefs = beliefs
        self._collection = collection
        self._redeployment = redeployment
        self._orders: list[Order] = []
        self._pose: tuple[float, float] | None = None
        self._charging = ChargingWatch(
            config.full_threshold, config.full_when, round(config.silence_timeout_s * 1000)
        )
        self._pool = ChargingPool(config, beliefs)
        self._strays = Strays(round(config.permission_repeat_s * 1000))
        self._must_begin = True
        """The primitive of the state is to be ordered: at birth, and after a resume."""
        self._began_ms: int | None = None

    @property
    def slots(self) -> tuple[int | None, ...]:
        """The agent in each dock, None for a free one."""
        held = dict(self.state.docked)
        return tuple(held.get(slot) for slot in range(SLOTS))

    def moved(self, north_m: float, east_m: float) -> None:
        """The aPad is here."""
        self._pose = (north_m, east_m)

    def receive(self, outcome: Outcome, now_ms: int) -> list[Order]:
        """Takes an outcome of the port; one of a primitive that is not under way changes nothing."""
        match outcome:
            case DockChanged(_, slot, agent_id, closed):
                held = dict(self.state.docked)
                if closed:
                    held[slot] = agent_id
                else:
                    held.pop(slot, None)
                self._set(docked=tuple(sorted(held.items())))
                self._note("dock", slot=slot, agent=agent_id, closed=closed)
            case PrimitiveSucceeded(_, primitive_id) if primitive_id == self.state.primitive_id:
                self._succeeded(now_ms)
            case PrimitiveFailed(_, primitive_id, reason) if primitive_id == self.state.primitive_id:
                self._failed(reason, now_ms)
        return self._take_orders()

    def advance(self, now_ms: int) -> list[Order]:
        """Acts on what is believed at `now_ms`."""
        self._learn_homes()
        if self._pose is None or self.state.phase is Phase.ENDED:
            return self._take_orders()
        if self._must_begin:
            if not self._can_begin(now_ms):
                return self._take_orders()
            self._must_begin = False
            self._begin_again(now_ms)
        match self.state.phase:
            case Phase.IDLE:
                self._consider_collecting(now_ms)
            case Phase.AWAIT_SURFACING:
                self._watch_surfacing(now_ms)
            case Phase.GO_COLLECT:
                self._repeat_permission(now_ms)
            case Phase.CHARGE:
                self._consider_deploying(now_ms)
        self._tell_strays(now_ms)
        return self._take_orders()

    def end(self, reason: str, now_ms: int) -> list[Order]:
        """Ends the mission where it stands: the aPad holds its position. A second call changes nothing."""
        if self.state.phase is not Phase.ENDED:
            self._hold(now_ms)
            self._enter(Phase.ENDED, now_ms, ended_by=reason)
        return self._take_orders()

    # What the aPad is doing, phase by phase.

    def _can_begin(self, now_ms: int) -> bool:
        """A resumed step waits until its aMussel is heard again, or has been silent for the stated time."""
        if self._began_ms is None:
            self._began_ms = now_ms
        if not self.state.plan.steps or self._beliefs.get(self._step.agent_id) is not None:
            return True
        return now_ms - self._began_ms > self._config.silence_timeout_s * 1000

    def _begin_again(self, now_ms: int) -> None:
        match self.state.phase:
            case Phase.IDLE:
                self._hold(now_ms)
            case Phase.CHARGE:
                self._hold(now_ms)
                self._charging.start(now_ms)
            case Phase.GO_COLLECT | Phase.AWAIT_SURFACING | Phase.DOCK:
                if self._step.agent_id in dict(self.state.docked).values():
                    self._finish_step(now_ms)
                else:
                    self._go_collect(now_ms)
            case Phase.GO_DEPLOY | Phase.UNDOCK:
                if self._step.agent_id in dict(self.state.docked).values():
                    self._go_deploy(now_ms)
                else:
                    self._finish_step(now_ms)

    def _consider_collecting(self, now_ms: int) -> None:
        if self.state.docked:
            # Docked by hand, or before a crash: charge what is there first.
            self._start_charging(now_ms)
            return
        pool = self._pool.candidates(now_ms)
        batch = self._pool.batch_of(pool)
        if not batch:
            return
        situation = self._situation(pool, {})
        name = self._config.collection
        solution = asked(name, lambda: self._collection.plan(situation, batch), situation, StepKind.COLLECT)
        if isinstance(solution, str):
            self._orders += self.end(solution, now_ms)
        elif solution.steps:
            self._orders.append(plan_note("collect", name, solution, situation, self._config.costs))
            self._set(plan=solution)
            self._go_collect(now_ms)

    def _go_collect(self, now_ms: int) -> None:
        belief = self._beliefs.get(self._step.agent_id)
        if belief is None:
            self._give_up("it was never heard", now_ms)
            return
        self._go_to(belief.north_m, belief.east_m)
        self._order(PermitSurfacing(belief.agent_id))
        self._enter(Phase.GO_COLLECT, now_ms, attempts=0)

    def _watch_surfacing(self, now_ms: int) -> None:
        belief = self._beliefs.get(self._step.agent_id)
        if belief is not None and belief.state is State.FLOATING:
            if self._pose is not None and self._distance(belief) > 2 * self._config.victory_radius_m:
                self._go_to(belief.north_m, belief.east_m)
                self._enter(Phase.GO_COLLECT, now_ms, attempts=self.state.attempts + 1)
            else:
                primitive_id = self._next_id()
                self._order(DockMussel(primitive_id, self._step.slot, belief.agent_id))
                self._enter(Phase.DOCK, now_ms)
            return
        self._repeat_permission(now_ms)

    def _repeat_permission(self, now_ms: int) -> None:
        """An aMussel still believed under water is told again; after so many times the step is given up."""
        belief = self._beliefs.get(self._step.agent_id)
        waited_ms = now_ms - self.state.since_ms
        if belief is not None and belief.state in (State.FLOATING, State.SURFACING):
            if (
                waited_ms > self._config.silence_timeout_s * 1000
                and self.state.phase is Phase.AWAIT_SURFACING
            ):
                self._give_up("it does not come up", now_ms)
            return
        if waited_ms < self._config.permission_repeat_s * 1000 * (self.state.attempts + 1):
            return
        if self.state.attempts + 1 < self._config.surfacing_attempts:
            self._set(attempts=self.state.attempts + 1)
            self._order(PermitSurfacing(self._step.agent_id))
        elif self.state.phase is Phase.AWAIT_SURFACING:
            self._give_up("it does not answer the permission to surface", now_ms)

    def _start_charging(self, now_ms: int) -> None:
        self._hold(now_ms)
        self._charging.start(now_ms)
        self._enter(Phase.CHARGE, now_ms, plan=Solution(()))

    def _consider_deploying(self, now_ms: int) -> None:
        docked = {agent_id: slot for slot, agent_id in self.state.docked}
        beliefs = {agent_id: self._beliefs.get(agent_id) for agent_id in docked}
        for agent_id, reason in self._charging.look(beliefs, now_ms):
            self._note("given_up", agent=agent_id, what="charge", reason=reason)
        if not self._charging.done(beliefs):
            return
        if not docked:
            self._idle(now_ms)
            return
        assert self._pose is not None
        known = [belief or unheard(agent_id, self._pose) for agent_id, belief in beliefs.items()]
        situation = self._situation(known, docked)
        name = self._config.redeployment
        solution = asked(name, lambda: self._redeployment.plan(situation), situation, StepKind.DEPLOY)
        if isinstance(solution, str):
            self._orders += self.end(solution, now_ms)
            return
        self._orders.append(plan_note("redeploy", name, solution, situation, self._config.costs))
        self._set(plan=solution)
        self._next_step(now_ms)

    def _go_deploy(self, now_ms: int) -> None:
        north_m, east_m = self._homes().get(self._step.agent_id, self._pose or (0.0, 0.0))
        self._go_to(north_m, east_m)
        self._enter(Phase.GO_DEPLOY, now_ms)

    def _idle(self, now_ms: int) -> None:
        self._hold(now_ms)
        self._enter(Phase.IDLE, now_ms, plan=Solution(()))

    def _succeeded(self, now_ms: int) -> None:
        match self.state.phase:
            case Phase.GO_COLLECT:
                self._enter(Phase.AWAIT_SURFACING, now_ms, attempts=0)
            case Phase.DOCK:
                self._finish_step(now_ms)
            case Phase.GO_DEPLOY:
                primitive_id = self._next_id()
                self._order(UndockMussel(primitive_id, self._step.slot, self._step.agent_id))
                self._enter(Phase.UNDOCK, now_ms)
            case Phase.UNDOCK:
                self._order(TellClear(self._step.agent_id))
                full = self._charging.is_full(self._beliefs.get(self._step.agent_id))
                self._note("released", agent=self._step.agent_id, full=full)
                self._finish_step(now_ms, services=self.state.services + full)

    def _failed(self, reason: str, now_ms: int) -> None:
        if self.state.plan.steps:
            self._give_up(reason, now_ms)

    def _give_up(self, reason: str, now_ms: int) -> None:
        step = self._step
        self._note("given_up", agent=step.agent_id, what=step.kind.value, reason=reason)
        self._pool.shun(step.agent_id, now_ms)
        self._finish_step(now_ms)

    def _finish_step(self, now_ms: int, *, services: int | None = None) -> None:
        services = self.state.services if services is None else services
        self._set(plan=Solution(self.state.plan.steps[1:]), services=services)
        self._next_step(now_ms)

    def _next_step(self, now_ms: int) -> None:
        if not self.state.plan.steps:
            # Docks that could not be opened are charged and tried again.
            if self.state.docked:
                self._start_charging(now_ms)
            else:
                self._idle(now_ms)
        elif self._step.kind is StepKind.COLLECT:
            self._go_collect(now_ms)
        else:
            self._go_deploy(now_ms)

    # Smaller questions and acts.

    @property
    def _step(self) -> Step:
        return self.state.plan.steps[0]

    def _situation(self, beliefs: list[Belief], slots: dict[int, int]) -> Situation:
        assert self._pose is not None
        return situation_of(self.state, self._pose, beliefs, slots)

    def _homes(self) -> dict[int, tuple[float, float]]:
        return {agent_id: (north_m, east_m) for agent_id, north_m, east_m in self.state.homes}

    def _learn_homes(self) -> None:
        homes = with_new_homes(self.state.homes, self._beliefs.all())
        if homes is not self.state.homes:
            self._set(homes=homes)

    def _tell_strays(self, now_ms: int) -> None:
        expected = {step.agent_id for step in self.state.plan.steps} | set(dict(self.state.docked).values())
        for agent_id in self._strays.to_tell(self._beliefs.all(), expected, now_ms):
            self._order(TellClear(agent_id))

    def _go_to(self, north_m: float, east_m: float) -> None:
        assert self._pose is not None
        metres = math.dist(self._pose, (north_m, east_m))
        self._set(cost_m=self.state.cost_m + metres)
        self._note("leg", metres=round(metres, 4))
        config = self._config
        self._order(GoToPoint(self._next_id(), north_m, east_m, config.speed_m_s, config.victory_radius_m))

    def _hold(self, now_ms: int) -> None:
        if self._pose is not None:
            self._order(HoldPosition(self._next_id(), *self._pose))

    def _distance(self, belief: Belief) -> float:
        assert self._pose is not None
        return math.dist(self._pose, (belief.north_m, belief.east_m))

    def _next_id(self) -> int:
        self._set(primitive_id=self.state.primitive_id + 1)
        return self.state.primitive_id

    def _enter(self, phase: Phase, now_ms: int, **changes: object) -> None:
        self._set(phase=phase, since_ms=now_ms, **changes)
        self._note("mission", phase=phase.value, snapshot=self.state.to_json())

    def _set(self, **changes: object) -> None:
        self.state = replace(self.state, **changes)  # type: ignore[arg-type]

    def _note(self, kind: str, **data: object) -> None:
        self._orders.append(Note(kind, data))

    def _order(self, order: Order) -> None:
        self._orders.append(order)

    def _take_orders(self) -> list[Order]:
        orders, self._orders = self._orders, []
        return orders
