"""The paper's energy-exchange mission (Fig. 7), from beliefs: wait, collect a batch, charge it, bring it back.

One aPad serves the aMussels of its beliefs. The mission acts when the supervisor calls `advance`, at every
mission tick. Every wait ends: see `Mission` in the scenario for the times, and the journal's notes for the
given-up steps. `Supervisor` decides that it ends, by time or by the aPad's battery.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import partial
from math import inf

from agents.time_scale import MissionMs
from apad_bridge.events.mission_events import MissionEnd, MissionState, Phase, StandsDown, StepGivenUp, Stuck
from apad_bridge.events.person_events import Steering
from apad_bridge.events.run_events import EndReason
from apad_bridge.mission.collecting import ANOTHER_BOARD, Collecting
from apad_bridge.mission.docking.docking_routine import DockingRoutine, Progress
from apad_bridge.mission.docking.docking_search import NOT_FOUND
from apad_bridge.mission.going_home import NO_HOME, GoingHome, HomeStays
from apad_bridge.mission.order_book import OrderBook
from apad_bridge.mission.orders import MissionAction, SendCommand
from apad_bridge.mission.phase_behaviour import PhaseAct, PhaseBehaviour
from apad_bridge.mission.policy.believed_dispatch import Docked, Due
from apad_bridge.mission.policy.plan_checks import Planning, StrategyFailed, without_progress
from apad_bridge.mission.policy.planner import Planner, PlanRules
from apad_bridge.mission.policy.pool import floats
from apad_bridge.mission.policy.reach import Reach
from apad_bridge.mission.sink_reminders import SinkReminders
from apad_bridge.mission.sources import BeliefSource
from apad_bridge.mission.stand_down_rule import Breakdown
from apad_bridge.planning.solution import StepKind
from apad_bridge.scenario.hull_in_flow import LegForecast
from apad_bridge.vehicle.outcomes import DockChanged, Outcome, PrimitiveFailed, PrimitiveSucceeded
from firmware_model.packets import Kind

STUCK_AFTER = 3
"""So many go-tos that fail in a row are the aPad's fault and not the aMussels'."""
BATTERY_REPORTED_AFTER_MS = 10_000
"""A battery that is needed and was not heard for so long is told, once."""
BARRED = "another aPad may dock it"
FORGOTTEN = "nothing is believed of it any more"
_COLLECTING = (Phase.GO_COLLECT, Phase.AWAIT_SURFACING)


class EnergyExchange(OrderBook):
    """`receive` takes the port's outcomes, `advance` acts at a tick, and `is_due` tells of a tick to come if it would.

    A resumed mission goes on from `state`. All beside it begins anew: the step under way with its tries, waits for silent
    aMussels, and what the first ticks find out again (whom the sea bars, that it is late, that a strategy refuses).
    """

    def __init__(
        self,
        rules: PlanRules,
        beliefs: BeliefSource,
        state: MissionState | None = None,
        home: HomeStays = NO_HOME,
        legs: LegForecast | None = None,
        *,
        needs_battery: bool = False,
        planning: Planning = without_progress,
        barred: Callable[[], frozenset[int]] = frozenset,
    ) -> None:
        """`home` says when the aPad goes home. With `legs` it serves nobody whom the sea bars.

        One that `needs_battery` does nothing before the aPad's battery was heard: a guard would refuse its go-tos.
        `planning` is entered while a strategy, by its name, plans. `barred` are the aMussels that other aPads may dock.
        """
        super().__init__(state or MissionState())
        self._beliefs = beliefs
        self._needs_battery = needs_battery
        self._reports_battery_ms: float | None = None
        """The time at which it tells that it waits for the battery; None before it waits."""
        self._reach = Reach(legs, self, beliefs)
        self._barred = barred
        self._planner = Planner(rules, beliefs, self, self._reach, planning, barred)
        config = rules.mission
        self.docking_routine = DockingRoutine(config, beliefs, self, 2 * config.victory_radius_m)
        self._sink_reminders = SinkReminders(round(config.permission_repeat_s * 1000))
        self._breakdown = Breakdown(STUCK_AFTER)
        self._collecting = Collecting(
            self,
            beliefs,
            self._planner,
            self._reach,
            self.docking_routine,
            self._finish_step,
            give_up=self._give_up,
        )
        self._home = GoingHome(self, self._planner, home, self._next_step, self._end)
        self._behaviours = {
            Phase.IDLE: PhaseBehaviour(self._hold, decide=self._decide_idle),
            **self._collecting.phases,
            Phase.CHARGE: PhaseBehaviour(
                self._hold_and_charge, tick=self._watch_charging, decide=self._decide_release
            ),
            Phase.GO_DEPLOY: PhaseBehaviour(self._resume_deploying, success=self._undock),
            Phase.UNDOCK: PhaseBehaviour(self._resume_undocking, success=self._finish_service),
            **self._home.phases,
            **dict.fromkeys((Phase.STANDS_DOWN, Phase.ENDED, Phase.COMMANDED), PhaseBehaviour()),
        }
        """The behaviour in each box of the paper's Fig. 7."""
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

    def receive(self, outcome: Outcome, now_ms: MissionMs) -> list[MissionAction]:
        """Takes an outcome of the port; an outcome of a primitive that is not under way changes nothing."""
        leg = self.state.leg
        self.note_outcome(outcome)
        if isinstance(outcome, DockChanged):
            self._collecting.called_up.discard(outcome.agent_id)
            self._planner.charging.restart(outcome.agent_id)
            if not outcome.closed:
                self._planner.tries.dock_opened(outcome.agent_id)
            return self.take_orders()
        progress = self.docking_routine.receive(outcome, now_ms)
        if self._awaits_person and not isinstance(outcome, PrimitiveSucceeded):
            return self.take_orders()
        if leg is not None and outcome.primitive_id == leg.primitive_id:
            self._breakdown.go_to_ended(outcome)
        if progress is Progress.GOES_ON:
            self.snapshot()  # a search has legs of its own, which a resume must count
            return self.take_orders()
        behaviour = self._behaviours[self.state.phase]
        if progress is Progress.NOT_FOUND:
            self._do(partial(self._collecting.dock_again, NOT_FOUND), now_ms)
        elif outcome.primitive_id == self.state.primitive_id:
            act: PhaseAct = behaviour.success
            if isinstance(outcome, PrimitiveFailed):
                act = partial(behaviour.failure or self._fail, outcome.reason)
            self._do(act, now_ms)
        if (reason := self._breakdown.take()) is not None:
            self.emit(Stuck(reason))
        return self.take_orders()

    def advance(self, now_ms: MissionMs) -> list[MissionAction]:
        """Acts on the beliefs at `now_ms`."""
        self._planner.places.learn(self._beliefs.all())
        if self.state.phase is Phase.ENDED:
            return self.take_orders()
        if self.unheard:
            self._report_unheard_battery(now_ms)
            return self.take_orders()
        if self._awaits_person:
            self._remind_to_sink(now_ms)
            return self.take_orders()
        self._planner.advance(now_ms)
        self.docking_routine.config = self._planner.config
        if self._must_begin:
            if not self._can_begin(now_ms):
                return self.take_orders()
            self._must_begin = False
            self._do(self._behaviours[self.state.phase].begin, now_ms)
        self._planner.settle_places()
        self._reach.look(self._planner.config, now_ms)
        self._do(self._look_at_the_time, now_ms)
        self._do(self._look_at_barred, now_ms)
        behaviour = self._behaviours[
            self.state.phase
        ]  # a phase that begins at this tick acts at the next one
        self._do(behaviour.tick, now_ms)
        self._do(partial(self._decide, behaviour), now_ms)
        self._remind_to_sink(now_ms)
        return self.take_orders()

    def is_due(self, now_ms: MissionMs) -> bool:
        """Tells whether `advance` does something at `now_ms`, by the beliefs and rules of that time. It changes nothing.

        It does not know when a charge stops to rise (`ChargingWatch`), nor how the sea or the time to be home will be. Near
        a known end the pool may shrink from tick to tick, so each is due. Before that the pool's rules do not change.
        """
        if self._must_begin or self._planner.is_changing(now_ms):
            return True
        if self._sink_reminders.due(self._beliefs.all(), self._expected, self._collecting.called_up, now_ms):
            return True
        if self.state.phase in _COLLECTING:
            return self.docking_routine.is_due(now_ms)
        try:
            return self._behaviours[self.state.phase].decide(now_ms) is not None
        except StrategyFailed:
            return True

    @property
    def watched(self) -> Iterable[int]:
        """The docked aMussels that are given up when their charge stops to rise, which `is_due` does not foresee."""
        return self._planner.to_release if self.state.phase is Phase.CHARGE else ()

    @property
    def leaves_home_at(self) -> float | None:
        """The aPad's battery at which it leaves its home; None while it is not there."""
        return self._home.leaves_at

    def change_planning(self, rules: PlanRules) -> None:
        """Plans, collects and releases by other rules from now on. The plan under way is flown to its end."""
        self._planner.change(rules)
        self.docking_routine.config = rules.mission

    def stand_down(self, reason: str, now_ms: MissionMs) -> list[MissionAction]:
        if self.state.phase not in (Phase.STANDS_DOWN, Phase.ENDED):
            self.emit(StandsDown(reason))
            self.docking_routine.pre_empt()
            self.enter(Phase.STANDS_DOWN, now_ms, plan=())
        return self.take_orders()

    def take_over(self, by: Steering = Steering.PERSON) -> str:
        return "this flight takes no calls: a person cannot take it over"

    def end(self, end: MissionEnd, now_ms: MissionMs) -> list[MissionAction]:
        """Ends the mission at once: the aPad holds its position. A second call changes nothing."""
        self._end(end, now_ms)
        return self.take_orders()

    def _do(self, act: PhaseAct, now_ms: MissionMs) -> None:
        """Acts; a strategy that fails ends the mission."""
        try:
            act(now_ms)
        except StrategyFailed as failed:
            self._end(MissionEnd(EndReason.STRATEGY_FAILED, str(failed)), now_ms)

    def _decide(self, behaviour: PhaseBehaviour, now_ms: MissionMs) -> None:
        if (act := behaviour.decide(now_ms)) is not None:
            act(now_ms)

    def _end(self, end: MissionEnd, now_ms: MissionMs) -> None:
        if self.state.phase is not Phase.ENDED:
            self.docking_routine.pre_empt()
            self.close(end, now_ms)

    def _report_unheard_battery(self, now_ms: MissionMs) -> None:
        """Tells it after a while. That the position is not heard, the supervisor tells."""
        if self.pose is None:
            return
        if self._reports_battery_ms is None:
            self._reports_battery_ms = now_ms + BATTERY_REPORTED_AFTER_MS
        elif now_ms >= self._reports_battery_ms:
            self._reports_battery_ms = inf
            self.emit(Stuck("its battery was not heard, and a guard refuses its go-tos until it is"))

    def _can_begin(self, now_ms: MissionMs) -> bool:
        """A resumed step waits until its aMussel is heard again, or has been silent for the stated time."""
        if self._began_ms is None:
            self._began_ms = now_ms
        if not self.state.plan or self._beliefs.get(self.step.agent_id) is not None:
            return True
        return now_ms - self._began_ms > self._planner.config.silence_timeout_s * 1000

    def _look_at_the_time(self, now_ms: MissionMs) -> None:
        """Drops what is not on the way home, once, when no time is left for it. A mechanism that moves is not stopped."""
        phase = self.state.phase
        if self._home.for_good or phase is Phase.STANDS_DOWN:
            return
        fetched = self._beliefs.get(self.step.agent_id) if phase in _COLLECTING else None
        if not self._home.must_return(now_ms, fetched) or phase is Phase.DOCK:
            return
        self._home.for_good = True
        if phase in _COLLECTING:
            self.docking_routine.pre_empt()
        if phase in (*_COLLECTING, Phase.IDLE):
            self.set(plan=())
            self._next_step(now_ms)

    def _look_at_barred(self, now_ms: MissionMs) -> None:
        """Leaves the aMussels of its plan that it may not dock any more, and one whose place it does not know any more.

        A mechanism that moves is not stopped.
        """
        if not self.state.plan:
            return
        barred = self._barred()
        first, *later = self.state.plan
        if not barred.isdisjoint(it.agent_id for it in later):
            self.set(plan=(first, *(it for it in later if it.agent_id not in barred)))
        if self.state.phase not in _COLLECTING and not self.docking_routine.is_on_search:
            return
        belief, reason = self._beliefs.get(first.agent_id), BARRED
        if first.agent_id not in barred:
            if belief is not None and not belief.is_of_another_board:
                return
            reason = FORGOTTEN if belief is None else ANOTHER_BOARD
        self.docking_routine.pre_empt()
        self.emit(StepGivenUp(first.agent_id, first.kind.value, reason))
        self._finish_step(now_ms)

    # Idle, and charging.

    def _hold(self, now_ms: MissionMs) -> None:
        self.order_hold()

    def _idle(self, now_ms: MissionMs) -> None:
        self.order_hold()
        self.enter(Phase.IDLE, now_ms, plan=())

    def _decide_idle(self, now_ms: MissionMs) -> PhaseAct | None:
        if self._planner.to_release:
            return self._start_charging  # docked by hand, or before a crash
        if self._home.is_called(now_ms):
            return self._home.go
        return None if self._home.for_good else self._decide_service({}, now_ms)

    def _hold_and_charge(self, now_ms: MissionMs) -> None:
        self.order_hold()
        self._planner.charging.begin(self._planner.to_release, now_ms)

    def _start_charging(self, now_ms: MissionMs) -> None:
        self._hold_and_charge(now_ms)
        self.enter(Phase.CHARGE, now_ms, plan=())

    def _watch_charging(self, now_ms: MissionMs) -> None:
        for agent_id, reason in self._planner.charging.give_up_stalled(self._planner.docked, now_ms):
            self.emit(StepGivenUp(agent_id, "charge", reason))

    def _decide_release(self, now_ms: MissionMs) -> PhaseAct | None:
        if not (docked := self._planner.docked):
            return self._idle
        if self._home.for_good or self._home.is_called(now_ms):
            return partial(self._release, Due(tuple(docked))) if self._home.releases_first else self._home.go
        return self._decide_service(docked, now_ms)

    def _decide_service(self, docked: Docked, now_ms: MissionMs) -> PhaseAct | None:
        due = self._planner.due(docked, now_ms)
        if due.released:
            return partial(self._release, due)
        return partial(self._collect, due) if due.count else None

    def _collect(self, due: Due, now_ms: MissionMs) -> None:
        if self._planner.collect(due.pool, due.count, now_ms):
            self._collecting.go(now_ms)

    def _release(self, due: Due, now_ms: MissionMs) -> None:
        """Has docked aMussels brought back, or take the places of others that are collected on the same tour."""
        if not (due.count and self._planner.collect(due.pool, due.count, now_ms, due.released)):
            self._planner.release(due.released, now_ms)
        self._next_step(now_ms)

    # Bringing an aMussel back.

    def _resume_deploying(self, now_ms: MissionMs) -> None:
        if self.is_held(self.step.agent_id):
            self._go_deploy(now_ms)
        else:
            self._finish_step(now_ms)

    def _resume_undocking(self, now_ms: MissionMs) -> None:
        """The dock may have opened when no supervisor was there to see it."""
        if self.is_held(self.step.agent_id):
            self._go_deploy(now_ms)
        else:
            self.docking_routine.released(self.step.agent_id)
            self._finish_service(now_ms)

    def _go_deploy(self, now_ms: MissionMs) -> None:
        if self.step.agent_id in self._reach.beyond:
            self._finish_step(now_ms)
            return
        self.order_go_to(self._planner.places.all().get(self.step.agent_id, self.here), self._planner.config)
        self.enter(Phase.GO_DEPLOY, now_ms)

    def _undock(self, now_ms: MissionMs) -> None:
        self.docking_routine.undock(self.step.dock_index, self.step.agent_id)
        self.enter(Phase.UNDOCK, now_ms)

    def _finish_service(self, now_ms: MissionMs) -> None:
        """Ends a release. A try has helped when the aMussel leaves with a charge above the pool's threshold."""
        agent_id, tries = self.step.agent_id, self._planner.tries
        self.set(released=tuple(sorted({**dict(self.state.released), agent_id: now_ms}.items())))
        if (belief := self._beliefs.get(agent_id)) is None or self._planner.pool.is_low(belief):
            tries.service_failed(agent_id, "it left its dock with too little charge")
        else:
            tries.service_helped(agent_id)
        self._finish_step(now_ms)

    # The plan's steps.

    def _fail(self, reason: str, now_ms: MissionMs) -> None:
        """A primitive has failed: its step is given up."""
        if self.state.plan:
            self._give_up(reason, now_ms)

    def _give_up(self, reason: str, now_ms: MissionMs) -> None:
        step, phase, planner = self.step, self.state.phase, self._planner
        if step.kind is StepKind.COLLECT and self._breakdown.failed <= 1:
            # Of go-tos that fail in a row only the first may be the aMussel's fault.
            planner.tries.service_failed(step.agent_id, reason)
        elif phase is Phase.UNDOCK:
            planner.charging.restart(step.agent_id)
            planner.tries.undocking_failed(step.agent_id, reason)
        self.emit(StepGivenUp(step.agent_id, step.kind.value, reason))
        belief, is_beside_it = self._beliefs.get(step.agent_id), phase in (Phase.AWAIT_SURFACING, Phase.DOCK)
        if not (is_beside_it and belief is not None and floats(belief)):
            # One that floats is a candidate again at once; a go-to that failed would only fail again.
            planner.pool.exclude(step.agent_id, now_ms)
        self._finish_step(now_ms)

    def _finish_step(self, now_ms: MissionMs) -> None:
        """Goes on with the plan. A strategy that pre-empts plans the rest of a batch anew, from the pool as it is now."""
        finished, *left = self.state.plan
        self.set(plan=tuple(left))
        collects = all(it.kind is StepKind.COLLECT for it in (finished, *left))
        if collects and left and self._planner.pre_empts and (pool := self._planner.candidates(now_ms)):
            self._planner.collect(pool, len(left), now_ms)
        self._planner.settle_places()
        self._next_step(now_ms)

    def _next_step(self, now_ms: MissionMs) -> None:
        if not self.state.plan:
            # Docks that could not be opened are charged and tried again, so often as `collection_attempts` says.
            if self._planner.to_release:
                self._start_charging(now_ms)
            else:
                self._idle(now_ms)
        elif self.step.kind is StepKind.COLLECT:
            self._collecting.go(now_ms)
        else:
            self._go_deploy(now_ms)

    # Reminders.

    def _remind_to_sink(self, now_ms: MissionMs) -> None:
        for agent_id in self._sink_reminders.take_due(
            self._beliefs.all(), self._expected, self._collecting.called_up, now_ms
        ):
            self.order(SendCommand(Kind.RELEASE, agent_id))

    @property
    def _expected(self) -> set[int]:
        """The aMussels of the plan and of the docks, which need no reminder to sink."""
        return {step.agent_id for step in self.state.plan} | set(dict(self.state.docked).values())
