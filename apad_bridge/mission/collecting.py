"""The collecting of an aMussel: the phases go to it, wait until it floats, and dock it."""

from __future__ import annotations

from collections.abc import Callable

from agents.time_scale import MissionMs
from apad_bridge.beliefs.belief import Belief
from apad_bridge.events.mission_events import Phase, StepGivenUp
from apad_bridge.mission.docking.docking_routine import DockingRoutine, DockingStep, GivenUp, OutOfReach
from apad_bridge.mission.order_book import OrderBook
from apad_bridge.mission.phase_behaviour import PhaseAct, PhaseBehaviour
from apad_bridge.mission.policy.docking_tries import StepTries
from apad_bridge.mission.policy.planner import Planner
from apad_bridge.mission.policy.reach import Reach
from apad_bridge.mission.sources import BeliefSource

ANOTHER_BOARD = "another board has its id now, and has not been heard"


class Collecting:
    """Flies the collecting step that is first in the plan. A resumed mission counts the step's go-tos and dockings anew."""

    def __init__(
        self,
        book: OrderBook,
        beliefs: BeliefSource,
        planner: Planner,
        reach: Reach,
        routine: DockingRoutine,
        finish_step: PhaseAct,
        give_up: Callable[[str, MissionMs], None],
    ) -> None:
        self._book = book
        self._beliefs = beliefs
        self._planner = planner
        self._reach = reach
        self._routine = routine
        self._finish_step = finish_step
        self._give_up = give_up
        self._tries = StepTries()
        self.called_up: set[int] = set()
        """The aMussels that this mission permitted to surface and that have not been docked since."""

    @property
    def phases(self) -> dict[Phase, PhaseBehaviour]:
        return {
            Phase.GO_COLLECT: PhaseBehaviour(
                self._resume, tick=self._repeat_permission, success=self._await_surfacing
            ),
            Phase.AWAIT_SURFACING: PhaseBehaviour(self._resume, tick=self._watch_surfacing),
            Phase.DOCK: PhaseBehaviour(self._resume, success=self._finish_step, failure=self.dock_again),
        }

    def go(self, now_ms: MissionMs) -> None:
        step, belief = self._book.step, self._beliefs.get(self._book.step.agent_id)
        if step.agent_id in self._reach.beyond:
            self._finish_step(now_ms)
            return
        if belief is None:
            self._give_up("it never reported", now_ms)
            return
        if belief.is_of_another_board:
            self._book.emit(StepGivenUp(step.agent_id, step.kind.value, ANOTHER_BOARD))
            self._finish_step(now_ms)
            return
        docks = self._book.docks
        if docks[step.dock_index] is not None:
            # The dock was to be empty by now, and did not open.
            if None not in docks:
                self._book.emit(StepGivenUp(step.agent_id, step.kind.value, "no dock is free"))
                self._finish_step(now_ms)
                return
            step = step._replace(dock_index=docks.index(None))
            self._book.set(plan=(step, *self._book.state.plan[1:]))
        self._tries = StepTries()
        self._go_to(belief, now_ms)
        self.called_up.add(belief.agent_id)
        self._routine.call_up(belief.agent_id, now_ms)
        self._book.enter(Phase.GO_COLLECT, now_ms)

    def dock_again(self, reason: str, now_ms: MissionMs) -> None:
        """Tries a failed docking again at once; an aMussel that no longer floats is permitted to surface again."""
        self._tries.failed_dockings += 1
        if self._tries.has_docking_left:
            self._await_surfacing(now_ms)
        else:
            self._give_up(reason, now_ms)

    def _resume(self, now_ms: MissionMs) -> None:
        if self._book.is_held(self._book.step.agent_id):
            self._finish_step(now_ms)
        else:
            self.go(now_ms)

    def _go_to(self, belief: Belief, now_ms: MissionMs) -> None:
        rules = self._planner.config
        self._book.order_go_to(self._reach.meeting_m(belief, rules, now_ms), rules)

    def _repeat_permission(self, now_ms: MissionMs) -> None:
        self._routine.advance(self._book.here, now_ms)

    def _await_surfacing(self, now_ms: MissionMs) -> None:
        self._routine.dock(self._book.step.dock_index, self._book.step.agent_id, now_ms)
        self._book.enter(Phase.AWAIT_SURFACING, now_ms)

    def _watch_surfacing(self, now_ms: MissionMs) -> None:
        try:
            step = self._routine.advance(self._book.here, now_ms)
        except OutOfReach:
            self._go_again(now_ms)
        except GivenUp as given_up:
            self._give_up(str(given_up), now_ms)
        else:
            if step is DockingStep.CLOSE:
                self._book.enter(Phase.DOCK, now_ms)

    def _go_again(self, now_ms: MissionMs) -> None:
        """Goes after an aMussel that floats out of reach, for the water has carried it on."""
        belief = self._beliefs.get(self._book.step.agent_id)
        assert belief is not None
        if not self._tries.has_leg_left:
            self._give_up(f"it still floats out of reach after {self._tries.legs} go-tos", now_ms)
            return
        self._tries.legs += 1
        self._go_to(belief, now_ms)
        self._book.enter(Phase.GO_COLLECT, now_ms)
