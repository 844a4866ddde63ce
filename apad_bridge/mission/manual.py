"""The aPad by hand: it follows a script or a person's calls, and plans nothing.

`flight_mission.py` flies it in place of the paper's mission, so port, beliefs, records and vehicles are the same. It runs
in the supervisor's one thread; a `CommandSource` gives the orders at every tick.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Protocol

from agents.time_scale import MissionMs
from apad_bridge.beliefs.belief import Belief
from apad_bridge.beliefs.input_ranges import FARTHEST_M
from apad_bridge.events.mission_events import PRE_EMPTED, MissionEnd, MissionState, Phase, StepGivenUp
from apad_bridge.mission.docking.docking_routine import DockingRoutine, GivenUp, OutOfReach, Progress
from apad_bridge.mission.docking.docking_search import NOT_FOUND
from apad_bridge.mission.order_book import OrderBook
from apad_bridge.mission.orders import MissionAction, SendCommand
from apad_bridge.mission.policy.charged_enough import is_full
from apad_bridge.mission.policy.home_places import HomePlaces
from apad_bridge.mission.script_values import EventLog, Refused, ScriptEventKind, Status, dock_of
from apad_bridge.mission.sink_reminders import SinkReminders
from apad_bridge.mission.sources import PredictingBeliefSource
from apad_bridge.scenario.blocks.mission_options import Mission
from apad_bridge.vehicle.commands import DEFAULT_MANOEUVRE, CloseDock, GoTo, Hold, Manoeuvre, OpenDock
from apad_bridge.vehicle.outcomes import (
    DockChanged,
    NothingCaught,
    Outcome,
    PrimitiveEnded,
    PrimitiveFailed,
    PrimitiveSucceeded,
)
from firmware_model.packets import Kind
from firmware_model.state_groups import BEYOND_HELP

REACH_M = 3.0
"""A person's docking is refused for an aMussel believed beyond this (or twice the victory radius)."""


class CommandSource(Protocol):
    """Gives the orders. The mission calls it in the supervisor's thread."""

    def act(self, mission: ManualMission, now_ms: MissionMs) -> None:
        """Gives orders, if there are any, by calling the mission's methods."""

    def close(self, reason: str) -> None:
        """The mission is over."""


class ManualMission(OrderBook):
    """Orders raise Refused, with one line, and then change nothing. Dock indices count from 0; NED metres."""

    def __init__(
        self,
        config: Mission,
        max_speed_m_s: float,
        beliefs: PredictingBeliefSource,
        command_sources: Sequence[CommandSource],
        state: MissionState | None = None,
    ) -> None:
        self.config = config
        self._max_speed_m_s = max_speed_m_s
        self.beliefs = beliefs
        super().__init__(replace(state or MissionState(), phase=Phase.COMMANDED))
        self.now_ms = MissionMs(0)
        self.goto = Status.IDLE
        self.paused = False
        self._paused_ms = 0
        self.goto_orders = 0
        """Number of accepted orders to go somewhere."""
        self.events = EventLog(config.pool_threshold)
        self.docking = Status.IDLE
        """The status of the last docking or undocking."""
        self.docking_orders = 0
        """Number of accepted orders to dock or undock."""
        self._docking: tuple[int, int] | None = None
        """(agent, dock index) of the last docking or undocking."""
        self._places = HomePlaces(self)
        self._sink_reminders = SinkReminders(round(config.permission_repeat_s * 1000))
        self._let_go: set[int] = set()
        """The aMussels that this mission undocked and that were not called up since."""
        reach_m = max(REACH_M, 2 * config.victory_radius_m)
        self._docking_routine = DockingRoutine(config, beliefs, self, reach_m)
        self._command_sources = command_sources
        self._target: GoTo | None = None
        """The target of the running or paused go-to."""
        self._begun = False
        self._awaited = self._pilot = ""
        """The reason why nothing moves before a person allows it, and why the aPad does not for a pilot; empty for none."""

    # The supervisor's interface.

    def await_person(self, reason: str, pilot: str = "") -> None:
        self._awaited, self._pilot = reason, pilot

    def receive(self, outcome: Outcome, now_ms: MissionMs) -> list[MissionAction]:
        self.now_ms = now_ms
        self.note_outcome(outcome)
        match outcome:
            case DockChanged(_, dock_index, agent_id, closed, _):
                self.events.record(
                    now_ms,
                    ScriptEventKind.DOCKED if closed else ScriptEventKind.UNDOCKED,
                    agent_id,
                    dock_of(dock_index),
                )
                if closed:
                    self._let_go.discard(agent_id)
                else:
                    self._let_go.add(agent_id)
            case PrimitiveSucceeded():
                self._end_primitive(outcome, Status.DONE, None)
            case NothingCaught():
                self._end_primitive(outcome, Status.FAILED, NOT_FOUND)
            case PrimitiveFailed(_, _, reason):
                self._end_primitive(
                    outcome, Status.PREEMPTED if reason == PRE_EMPTED else Status.FAILED, reason
                )
        return self.take_orders()

    def begin(self, now_ms: MissionMs) -> None:
        """Has the aPad hold where it is, once, as soon as its place is known: before anybody's first order."""
        if self._begun or self.pose is None or self.state.phase is Phase.ENDED:
            return
        self._begun, self.now_ms = True, now_ms
        self._places.learn(self.beliefs.all())
        self.order_hold()
        self.snapshot()

    def advance(self, now_ms: MissionMs) -> list[MissionAction]:
        self.now_ms = now_ms
        self._places.learn(self.beliefs.all())
        if self.pose is None or self.state.phase is Phase.ENDED:
            return self.take_orders()
        self.begin(now_ms)
        self.events.compare(self.beliefs.all(), now_ms)
        if not self.paused:
            self._advance_docking(self.pose)
        for command_source in self._command_sources:
            command_source.act(self, now_ms)
        self._remind_to_sink(now_ms)
        return self.take_orders()

    def stand_down(self, reason: str, now_ms: MissionMs) -> list[MissionAction]:
        return []

    def end(self, end: MissionEnd, now_ms: MissionMs) -> list[MissionAction]:
        self.now_ms = now_ms
        self.finish(end)
        return self.take_orders()

    def finish(self, end: MissionEnd) -> None:
        """Like `end`, from within a command source: the orders go out with those of this tick."""
        if self.state.phase is Phase.ENDED:
            return
        self.close(end, self.now_ms)
        for command_source in self._command_sources:
            command_source.close(str(end))

    # The interface of command sources.

    @property
    def is_busy(self) -> bool:
        """A primitive that ends by itself is under way."""
        return not self.paused and Status.RUNNING in (self.goto, self.docking)

    @property
    def failure(self) -> str | None:
        """The reason of the last failed primitive."""
        return self.events.failure

    @property
    def metres_to_go(self) -> float | None:
        """The straight distance to the target of the go-to under way."""
        if self._target is None or self.pose is None:
            return None
        return math.dist(self.pose, (self._target.north_m, self._target.east_m))

    def is_full(self, agent_id: int) -> bool:
        """The aMussel is believed full, by the scenario's definition."""
        return is_full(self.beliefs.get(agent_id), self.config)

    def go_to(
        self, north_m: float, east_m: float, speed_m_s: float | None = None, radius_m: float | None = None
    ) -> None:
        """Goes to a point; the scenario gives the default speed and victory radius."""
        self._require_leave()
        target = self.go_to_target(north_m, east_m, speed_m_s, radius_m)
        self._pre_empt_docking()
        self.goto_orders += 1
        self._start_go_to(target)

    def go_to_target(
        self, north_m: float, east_m: float, speed_m_s: float | None = None, radius_m: float | None = None
    ) -> GoTo:
        """The target that `go_to` would take, without an id yet; Refused for one that it would not take."""
        speed_m_s = self.config.speed_m_s if speed_m_s is None else speed_m_s
        radius_m = self.config.victory_radius_m if radius_m is None else radius_m
        if not all(map(math.isfinite, (north_m, east_m, speed_m_s, radius_m))):
            raise Refused("a go-to needs finite numbers")
        _refuse_far(north_m, east_m)
        if speed_m_s <= 0 or radius_m <= 0:
            raise Refused(
                "speed and victory radius must be above 0: an aPad of the field gives up on anything else"
            )
        if speed_m_s > self._max_speed_m_s:
            raise Refused(f"a speed of {speed_m_s:g} m/s: apad.max_speed_m_s is {self._max_speed_m_s:g} m/s")
        return GoTo(0, north_m, east_m, speed_m_s, radius_m)

    def hold(self, north_m: float | None = None, east_m: float | None = None) -> None:
        """Dynamic positioning at a point, or at the aPad's place; it pre-empts any primitive."""
        here = self._require_leave()
        point = (here[0] if north_m is None else north_m, here[1] if east_m is None else east_m)
        if not all(map(math.isfinite, point)):
            raise Refused("a hold needs finite numbers")
        _refuse_far(*point)
        self._pre_empt_docking()
        self.order(Hold(self.next_id(), *point))

    def dock(self, dock_index: int, agent_id: int, manoeuvre: Manoeuvre = DEFAULT_MANOEUVRE) -> None:
        """Permits the aMussel to surface, waits until it floats, and closes the mechanism around it."""
        here = self._require_leave()
        self._refuse_dock(dock_index, agent_id, here)
        self._pre_empt_docking()
        if self.goto is Status.RUNNING:
            self.order_hold()
        self._let_go.discard(agent_id)
        self._begin_docking(agent_id, dock_index)
        self._docking_routine.dock(dock_index, agent_id, self.now_ms, manoeuvre)
        self._advance_docking(here)
        self.snapshot()

    def undock(self, dock_index: int, manoeuvre: Manoeuvre = DEFAULT_MANOEUVRE) -> None:
        """Opens a mechanism, and tells its aMussel that it is clear to sink."""
        self._require_leave()
        if (agent_id := self.docks[dock_index]) is None:
            raise Refused(f"dock {dock_of(dock_index)} is empty")
        self._pre_empt_docking()
        self._begin_docking(agent_id, dock_index)
        self._docking_routine.undock(dock_index, agent_id, manoeuvre)
        self.snapshot()

    def permit_surfacing(self, agent_id: int) -> None:
        self._require_leave(moves=False)
        self._belief_of(agent_id)
        self._let_go.discard(agent_id)
        self._docking_routine.permit_surfacing(agent_id)

    def call_up(self, agent_id: int) -> None:
        """Permits the aMussel to surface, and repeats it on the way there; for a go-to that was just ordered."""
        self._require_leave(moves=False)
        self._belief_of(agent_id)
        self._let_go.discard(agent_id)
        self._docking_routine.call_up(agent_id, self.now_ms)

    def send_command(self, kind: Kind, agent_id: int) -> None:
        self._require_place()
        self.order(SendCommand(kind, agent_id))

    def pause(self) -> None:
        """Holds position. A go-to goes on later; a search ends; a commanded mechanism is not stopped half-way."""
        self._require_place()
        if self._docking_routine.is_on_search:
            self._pre_empt_docking()
        self.paused, self._paused_ms = True, self.now_ms
        if self.goto is Status.RUNNING:
            assert self._target is not None
            # The outcome of the pre-empted primitive must match no target.
            self._target = replace(self._target, command_id=0)
            self.order_hold()
        self.snapshot()

    def resume(self) -> bool:
        """Goes on where `pause` stopped. False, and nothing happens, when the mission was not paused."""
        if not self.paused:
            return False
        self._refuse_held()
        self.paused = False
        self._docking_routine.paused_for(self.now_ms - self._paused_ms)
        if self.goto is Status.RUNNING and self._target is not None:
            self._start_go_to(self._target)
        return True

    def stop(self) -> None:
        """Like `pause`, and before the aPad's place is known, too."""
        if self.pose is None:
            self.paused, self._paused_ms = True, self.now_ms
        else:
            self.pause()

    def forget_stopped(self) -> None:
        """Forgets the go-to that `pause` stopped, for another order in its place; the aPad goes on holding."""
        if not self.paused:
            return
        self.paused = False
        self._docking_routine.paused_for(self.now_ms - self._paused_ms)
        if self.goto is Status.RUNNING:
            self._target = None
            self.goto = Status.PREEMPTED
            self.events.record(self.now_ms, ScriptEventKind.GOTO, status=self.goto, reason=PRE_EMPTED)
        self.snapshot()

    def go_on_with(self, mechanism: CloseDock | OpenDock | None) -> None:
        """Awaits the end of a mechanism that the mission before this one has ordered; None for none."""
        if mechanism is not None:
            self._begin_docking(mechanism.agent_id, mechanism.dock_index)
            self._docking_routine.mechanism = mechanism

    # Helpers.

    def _remind_to_sink(self, now_ms: MissionMs) -> None:
        let_go = [belief for belief in self.beliefs.all() if belief.agent_id in self._let_go]
        for agent_id in self._sink_reminders.take_due(let_go, (), self._let_go, now_ms):
            self.order(SendCommand(Kind.RELEASE, agent_id))

    def _require_leave(self, *, moves: bool = True) -> tuple[float, float]:
        """The aPad's place, for an order that moves it, or else an aMussel. Refused where the gate would not let it out."""
        if self.state.phase is not Phase.ENDED:
            self._refuse_held(moves=moves)
        return self._require_place()

    def _refuse_held(self, *, moves: bool = True) -> None:
        if self._awaited:
            raise Refused(f"nothing moves until a person continues: {self._awaited}")
        if moves and self._pilot:
            raise Refused(self._pilot)

    def _require_place(self) -> tuple[float, float]:
        if self.state.phase is Phase.ENDED:
            raise Refused(f"the mission is over: {self.state.ended_by}")
        if self.paused:
            raise Refused("the aPad was stopped: continue first, or resume where a script paused it")
        if self.pose is None:
            raise Refused("the aPad's place is not known yet")
        return self.pose

    def _start_go_to(self, target: GoTo) -> None:
        self._target = replace(target, command_id=self.next_id())
        self.goto = Status.RUNNING
        self.order(self._target)
        self.snapshot()

    def _end_primitive(self, outcome: PrimitiveEnded, status: Status, reason: str | None) -> None:
        if self._target is not None and outcome.primitive_id == self._target.command_id:
            self._target = None
            self.goto = status
            self.events.record(self.now_ms, ScriptEventKind.GOTO, status=status, reason=reason)
            self.snapshot()
        elif self._docking_routine.receive(outcome, self.now_ms) in (Progress.ENDED, Progress.NOT_FOUND):
            self._end_docking(status, reason)

    def _belief_of(self, agent_id: int) -> Belief:
        """The belief about an aMussel. Refused when the aMussel was never heard."""
        if (belief := self.beliefs.get(agent_id)) is None:
            # In ROS 1 a field that is left out of a call is 0.
            hint = "" if agent_id else ": give the aMussel's id; it is 0 if left out"
            raise Refused(f"aMussel {agent_id} never reported{hint}")
        return belief

    def _refuse_dock(self, dock_index: int, agent_id: int, here: tuple[float, float]) -> None:
        """Refused for an aMussel that cannot be docked from here."""
        belief, docks = self._belief_of(agent_id), self.docks
        if docks[dock_index] is not None:
            raise Refused(f"dock {dock_of(dock_index)} holds aMussel {docks[dock_index]}")
        if agent_id in docks:
            raise Refused(f"aMussel {agent_id} is in dock {dock_of(docks.index(agent_id))} already")
        if belief.state in BEYOND_HELP:
            raise Refused(f"aMussel {agent_id} is lost: it can no longer surface")
        try:
            self._docking_routine.check_reach(belief, here)
        except OutOfReach as out_of_reach:
            raise Refused(str(out_of_reach)) from None

    def _begin_docking(self, agent_id: int, dock_index: int) -> None:
        self._docking = (agent_id, dock_index)
        self.docking = Status.RUNNING
        self.docking_orders += 1

    def _advance_docking(self, here: tuple[float, float]) -> None:
        try:
            self._docking_routine.advance(here, self.now_ms)
        except GivenUp as given_up:
            assert self._docking is not None
            self.emit(StepGivenUp(self._docking[0], "dock", str(given_up)))
            self._end_docking(Status.FAILED, str(given_up))

    def _pre_empt_docking(self) -> None:
        """Ends the wait or the search for an aMussel. Once the mechanism is ordered, the port decides instead."""
        if self._docking_routine.is_on_search:
            self.order_hold()
        if self._docking_routine.pre_empt():
            self._end_docking(Status.PREEMPTED, PRE_EMPTED)

    def _end_docking(self, status: Status, reason: str | None) -> None:
        assert self._docking is not None
        agent_id, dock_index = self._docking
        self.docking = status
        self.events.record(
            self.now_ms, ScriptEventKind.DOCKING, agent_id, dock_of(dock_index), status, reason
        )


def _refuse_far(north_m: float, east_m: float) -> None:
    """Refuses far places, which come from a call without a place (0 degrees north and east) or in a wrong unit."""
    if math.hypot(north_m, east_m) > FARTHEST_M:
        raise Refused(
            f"the goal lies {math.hypot(north_m, east_m):.0f} m from the scenario's origin: is it [latitude, longitude] "
            "in degrees where those are asked for, and metres elsewhere?"
        )
