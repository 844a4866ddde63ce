"""Phases of the mission, as objects: each owns what only its phases need, and gives their behaviour."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from agents.time_scale import MissionMs
from apad_bridge.beliefs.belief import Belief
from apad_bridge.events.mission_events import MissionEnd, Phase, StepGivenUp
from apad_bridge.events.run_events import EndReason
from apad_bridge.mission.docking_routine import DockingRoutine, DockingStep, GivenUp, OutOfReach
from apad_bridge.mission.home_stays import HomeStays
from apad_bridge.mission.order_book import OrderBook
from apad_bridge.mission.planner import Planner
from apad_bridge.mission.reach import Reach
from apad_bridge.mission.sources import BeliefSource

LEGS_PER_STEP = 3
"""A step is given up when its aMussel floats out of reach after so many go-tos."""
DOCKINGS_PER_STEP = 3
"""A step is given up after so many failed dockings, because an aMussel spends most of its charge at the surface."""
HOME_AGAIN_MS = 10_000
"""A failed way home for good is tried again after so long: the time to be there is near."""
ANOTHER_BOARD = "another board has its id now, and has not been heard"
PhaseAct = Callable[[MissionMs], None]
"""It is called with the time at which it is done."""


def nothing(now_ms: MissionMs) -> None:
    pass


@dataclass(frozen=True, slots=True)
class PhaseBehaviour:
    begin: PhaseAct = nothing
    """Runs when the mission starts in this phase, which may be in the middle of a resumed run."""
    tick: PhaseAct = nothing
    decide: Callable[[MissionMs], PhaseAct | None] = lambda now_ms: None
    """Decides, after `tick`, what to do now: an act that is not done yet, or None to wait. It changes nothing.

    These are the boxes of the paper's Fig. 7 that ask something.
    """
    success: PhaseAct = nothing
    """Runs when the phase's primitive has succeeded."""
    failure: Callable[[str, MissionMs], None] | None = None
    """Runs, with the reason, when it has failed; None gives the step up."""


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
        self._legs = 0
        """Number of go-tos to the aMussel of the step under way."""
        self._dockings = 0
        """Number of failed dockings of the step under way."""
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
        self._legs, self._dockings = 1, 0
        self._go_to(belief, now_ms)
        self.called_up.add(belief.agent_id)
        self._routine.call_up(belief.agent_id, now_ms)
        self._book.enter(Phase.GO_COLLECT, now_ms)

    def dock_again(self, reason: str, now_ms: MissionMs) -> None:
        """Tries a failed docking again at once; an aMussel that no longer floats is permitted to surface again."""
        self._dockings += 1
        if self._dockings < DOCKINGS_PER_STEP:
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
        if self._legs >= LEGS_PER_STEP:
            self._give_up(f"it still floats out of reach after {self._legs} go-tos", now_ms)
            return
        self._legs += 1
        self._go_to(belief, now_ms)
        self._book.enter(Phase.GO_COLLECT, now_ms)


class GoingHome:
    """Brings the aPad home: to be charged, while it is unavailable, or for good when the time to be there is near."""

    def __init__(
        self,
        book: OrderBook,
        planner: Planner,
        stays: HomeStays,
        next_step: PhaseAct,
        end: Callable[[MissionEnd, MissionMs], None],
    ) -> None:
        self._book = book
        self._planner = planner
        self._stays = stays
        self._next_step = next_step
        self._end = end
        self.for_good = False
        """The docked aMussels go back as they are, and the aPad goes home. A resumed mission finds it out again."""
        self._failed_ms: int | None = None
        """The time at which a way home failed; it is not tried again for a while."""

    @property
    def phases(self) -> dict[Phase, PhaseBehaviour]:
        return {
            Phase.GO_HOME: PhaseBehaviour(self.go, success=self._arrive, failure=self._miss),
            Phase.AT_HOME: PhaseBehaviour(self.go, decide=self._decide),
        }

    @property
    def releases_first(self) -> bool:
        """Docked aMussels leave before the aPad goes home."""
        return self.for_good or self._stays.releases_first

    @property
    def leaves_at(self) -> float | None:
        """The aPad's battery at which it leaves its home; None while it is not there."""
        return self._stays.leaves_at if self._book.state.phase is Phase.AT_HOME else None

    def must_return(self, now_ms: MissionMs, fetched: Belief | None) -> bool:
        """True once no time is left but for the way home, with the aMussel that the aPad is fetching."""
        if self._stays.end_by is None:
            return False
        homes, here = self._planner.places.all(), self._book.here
        releases_m = [homes.get(it, here) for it in self._planner.to_release]
        fetched_m = None if fetched is None else (fetched.north_m, fetched.east_m)
        return self._stays.end_by.must_return(now_ms, here, releases_m, fetched_m)

    def is_called(self, now_ms: MissionMs) -> bool:
        patience_ms = HOME_AGAIN_MS if self.for_good else self._planner.config.silence_timeout_s * 1000
        if self._failed_ms is not None and now_ms - self._failed_ms <= patience_ms:
            return False
        return self.for_good or self._stays.must_go(now_ms, self._book.apad_battery)

    def go(self, now_ms: MissionMs) -> None:
        self._book.order_go_to(self._stays.place_m, self._planner.config)
        self._book.enter(Phase.GO_HOME, now_ms, plan=())

    def _arrive(self, now_ms: MissionMs) -> None:
        self._failed_ms = None
        if self.for_good:
            self._end(MissionEnd(EndReason.END_BY), now_ms)
            return
        self._book.order_hold()
        self._book.enter(Phase.AT_HOME, now_ms)

    def _miss(self, reason: str, now_ms: MissionMs) -> None:
        self._failed_ms = now_ms
        self._next_step(now_ms)

    def _decide(self, now_ms: MissionMs) -> PhaseAct | None:
        leaves = self.for_good or self._stays.may_leave(now_ms, self._book.apad_battery)
        return self._next_step if leaves else None
