"""The docking port turns mission primitives into commands for ANY vehicle, and its facts into outcomes.

The docking profiles live here, so that every stack behind the port behaves alike. `virtual` waits out the
docking time before it commands the mechanism. `camera` and `visual` command the mechanism at once and leave
the time to the vehicle. `camera` needs a vehicle that `sees_amussels`; on any other vehicle it is `virtual`.

A virtual docking begins only if the aMussel floats within `docking.catch_radius_m` of the aPad. No published stack
checks that: a perch of generation A succeeds from anywhere, and the docking of generation B finds by eye. So the
bench does, at the docking's start: the mechanism then holds the aMussel, and the docking time passes. The search is
the mission's, with go-tos, for a docking of generation A does not move the vehicle.

`TABLE` alone decides what a primitive does next. The port drops and counts an event that the table does not
name in the present phase and never raises: such an event is a late or wrong report from the vehicle.

A go-to has a stall watch (`GoToProgress`), because vehicles do not report when they are stuck.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from enum import Enum, auto

from apad_bridge.beliefs.input_ranges import out_of_range
from apad_bridge.events.mission_events import PRE_EMPTED
from apad_bridge.scenario.blocks.mission_options import ArmUse, Docking, DockingProfile
from apad_bridge.vehicle.capabilities import Capabilities, of_simulated_apad
from apad_bridge.vehicle.commands import (
    Arrived,
    BatteryReported,
    CloseDock,
    CommandAccepted,
    CommandedByOthers,
    CommandFailed,
    DockClosed,
    DockOpened,
    DocksNamed,
    GoalOfOthers,
    GoTo,
    Hold,
    MoveArm,
    OpenDock,
    PilotReported,
    PoseReported,
    Primitive,
    VehicleCommand,
    VehicleFact,
)
from apad_bridge.vehicle.go_to_progress import STALL_S, GoToProgress
from apad_bridge.vehicle.outcomes import (
    DockChanged,
    NothingCaught,
    Occupancy,
    Outcome,
    PrimitiveFailed,
    PrimitiveSucceeded,
    after_report,
    dock_index_of,
)


class DockingPhase(Enum):
    IDLE = auto()
    GOING = auto()
    HOLDING = auto()
    WAITING = auto()
    """A dock or undock before its mechanism is commanded: the virtual profile's time."""
    ACTING = auto()
    """The mechanism was commanded; only a vehicle's report or the time-out ends this phase."""


class DockingEvent(Enum):
    ARRIVED = auto()
    COMMAND_FAILED = auto()
    MECHANISM_DONE = auto()
    """The dock closed around, or opened for, the aMussel of the running primitive."""
    NOTHING_CAUGHT = auto()
    """The aMussel does not float within the catch radius."""
    WAIT_OVER = auto()
    TIMED_OUT = auto()
    REPLACED = auto()
    """The mission ordered another primitive."""


class Effect(Enum):
    SUCCEED = auto()
    FAIL = auto()
    END_EMPTY = auto()
    """End a docking that caught nothing."""
    ACT = auto()
    """Command the mechanism."""
    QUEUE = auto()
    """Keep the new primitive until the running one ends."""
    RETRY = auto()
    """Try the mechanism once more, or fail after the last allowed attempt."""
    START = auto()


TABLE: dict[tuple[DockingPhase, DockingEvent], Effect] = {
    (DockingPhase.IDLE, DockingEvent.REPLACED): Effect.START,
    (DockingPhase.GOING, DockingEvent.ARRIVED): Effect.SUCCEED,
    (DockingPhase.GOING, DockingEvent.COMMAND_FAILED): Effect.FAIL,
    (DockingPhase.GOING, DockingEvent.TIMED_OUT): Effect.FAIL,
    (DockingPhase.GOING, DockingEvent.REPLACED): Effect.FAIL,
    (DockingPhase.HOLDING, DockingEvent.COMMAND_FAILED): Effect.FAIL,
    (DockingPhase.HOLDING, DockingEvent.REPLACED): Effect.SUCCEED,
    (DockingPhase.WAITING, DockingEvent.MECHANISM_DONE): Effect.SUCCEED,
    (DockingPhase.WAITING, DockingEvent.NOTHING_CAUGHT): Effect.END_EMPTY,
    (DockingPhase.WAITING, DockingEvent.WAIT_OVER): Effect.ACT,
    (DockingPhase.WAITING, DockingEvent.REPLACED): Effect.FAIL,
    (DockingPhase.ACTING, DockingEvent.MECHANISM_DONE): Effect.SUCCEED,
    (DockingPhase.ACTING, DockingEvent.COMMAND_FAILED): Effect.RETRY,
    (DockingPhase.ACTING, DockingEvent.TIMED_OUT): Effect.FAIL,
    (DockingPhase.ACTING, DockingEvent.REPLACED): Effect.QUEUE,
}


PortAction = VehicleCommand | Outcome
_SIMULATED = of_simulated_apad()


DistanceM = Callable[[int, float, float], float | None]
"""The distance in m from a place (north, east, in m) to an aMussel, by its id. Infinite for one that does not float, and
None for one that the bench does not simulate."""


class DockingPort:
    """Runs one primitive at a time. A new one pre-empts the running one, but a commanded mechanism ends first.

    The port tries a failing mechanism `docking.attempts` times and reports the first cause.

    Every wait ends. Each try of a dock or undock ends `docking.timeout_s` after it began. A go-to ends
    `stall_s` after the vehicle accepted it or last got 0.5 m nearer, or when it was not accepted within `stall_s`. The port
    then orders the vehicle to hold at its last known position. A vehicle that does not obey speeds goes as it is set, which
    should be `usual_go_to` (speed, victory radius): other orders are counted. A port that follows another port on the same
    vehicle begins with the docks as the other knew them, `docked`. It numbers its commands from `first_command_id`, beyond
    the other's, so that late answers to the old commands match nothing. A virtual docking catches what floats within the
    catch radius, by `distance_m`. `first_failure` is that of a port before.
    """

    def __init__(
        self,
        docking: Docking,
        *,
        stall_s: float = STALL_S,
        first_command_id: int = 1,
        capabilities: Capabilities = _SIMULATED,
        usual_go_to: tuple[float, float] | None = None,
        docked: Occupancy = (),
        distance_m: DistanceM = lambda agent_id, north_m, east_m: None,
        first_failure: PrimitiveFailed | None = None,
    ) -> None:
        if not stall_s > 0:
            raise ValueError("stall_s must be above 0")
        self._docking = docking
        self._capabilities = capabilities
        self._usual_go_to = usual_go_to
        self._stall_ms = round(stall_s * 1000)
        self._next_command_id = first_command_id
        self._now_ms = 0
        self._phase = DockingPhase.IDLE
        self.running: Primitive | None = None
        self._queued: Primitive | None = None
        self._command_id: int | None = None
        """The running primitive's command; facts that name another command are late."""
        self._tries = 0
        """Attempts of the running primitive's mechanism."""
        self._first_cause = ""
        """The cause of the first failed attempt."""
        self._arm_dock: int | None = None
        """The dock whose arm was opened for people to see."""
        self._act_ms: int | None = None
        self._deadline_ms: int | None = None
        self._progress: GoToProgress | None = None
        self._pose: PoseReported | None = None
        self.docked = docked
        """The supervisor's table of the docks; `vehicle/outcomes.py` states its sources and its rule."""
        self.dropped: Counter[str] = Counter()
        """Unusable reports of the vehicle, by reason."""
        self.first_failure = first_failure
        """The first cause since a go-to, dock or undock last succeeded. A pre-emption does not count."""
        self._distance_m = distance_m

    @property
    def next_due_ms(self) -> int | None:
        deadline_ms = self._progress.deadline_ms if self._progress is not None else self._deadline_ms
        dues = [due_ms for due_ms in (self._act_ms, deadline_ms) if due_ms is not None]
        return min(dues) if dues else None

    def advance(self, now_ms: int) -> list[PortAction]:
        """Fire the timers due at or before `now_ms`. Raises ValueError when time went back."""
        if now_ms < self._now_ms:
            raise ValueError(f"time went back from {self._now_ms} to {now_ms} ms")
        actions: list[PortAction] = []
        while (due_ms := self.next_due_ms) is not None and due_ms <= now_ms:
            event = DockingEvent.WAIT_OVER if due_ms == self._act_ms else DockingEvent.TIMED_OUT
            self._apply(event, due_ms, actions, self._time_out_reason())
        self._now_ms = now_ms
        return actions

    def receive(self, stimulus: Primitive | VehicleFact, now_ms: int) -> list[PortAction]:
        """Take a primitive from the mission or a fact from the vehicle, after the timers due until then."""
        actions = self.advance(now_ms)
        match stimulus:
            case GoTo() | Hold() | CloseDock() | OpenDock():
                self._order(stimulus, now_ms, actions)
            case PoseReported():
                self._take_pose(stimulus, now_ms)
            case CommandAccepted():
                if self._progress is not None and stimulus.command_id == self._command_id:
                    self._progress.begin(self._pose, now_ms)
            case Arrived():
                self._receive_answer(DockingEvent.ARRIVED, stimulus.command_id, now_ms, actions)
            case CommandFailed():
                self._receive_answer(
                    DockingEvent.COMMAND_FAILED, stimulus.command_id, now_ms, actions, stimulus.reason
                )
            case DockClosed() | DockOpened():
                self._take_dock(stimulus, now_ms, actions)
            case BatteryReported() | CommandedByOthers() | PilotReported() | GoalOfOthers() | DocksNamed():
                pass  # the supervisor takes them from the vehicle directly
        return actions

    def _order(self, primitive: Primitive, now_ms: int, actions: list[PortAction]) -> None:
        was_going = self._phase is DockingPhase.GOING
        if TABLE[self._phase, DockingEvent.REPLACED] is Effect.QUEUE:
            if self._queued is not None:
                actions.append(PrimitiveFailed(now_ms, self._queued.command_id, PRE_EMPTED))
            self._queued = primitive
            return
        self._apply(DockingEvent.REPLACED, now_ms, actions, PRE_EMPTED)
        if was_going and isinstance(primitive, CloseDock | OpenDock):
            self._hold_here(actions)
        self._start(primitive, now_ms, actions)

    def _start(self, primitive: Primitive, now_ms: int, actions: list[PortAction]) -> None:
        self.running = primitive
        self._tries, self._first_cause = 0, ""
        match primitive:
            case GoTo(_, north_m, east_m, speed_m_s, victory_radius_m):
                self._phase = DockingPhase.GOING
                self._progress = GoToProgress(north_m, east_m, self._stall_ms, now_ms, self._pose)
                self._command_id = self._take_command_id()
                wanted = (speed_m_s, victory_radius_m)
                if not self._capabilities.obeys_speed and self._usual_go_to not in (None, wanted):
                    self.dropped["speed or victory radius of a go-to: the aPad uses its own"] += 1
                actions.append(replace(primitive, command_id=self._command_id))
            case Hold():
                self._phase = DockingPhase.HOLDING
                self._command_id = self._take_command_id()
                actions.append(replace(primitive, command_id=self._command_id))
            case CloseDock() | OpenDock():
                self._start_mechanism(primitive, now_ms, actions)

    def _start_mechanism(
        self, primitive: CloseDock | OpenDock, now_ms: int, actions: list[PortAction]
    ) -> None:
        self._phase = DockingPhase.WAITING
        self._tries += 1
        if isinstance(primitive, CloseDock) and dock_index_of(self.docked, primitive.agent_id) is not None:
            # A second request would make the public simulator hold the aMussel twice.
            self._apply(DockingEvent.MECHANISM_DONE, now_ms, actions)
            return
        if isinstance(primitive, CloseDock) and not self._catches(primitive.agent_id):
            self._apply(DockingEvent.NOTHING_CAUGHT, now_ms, actions)
            return
        self._open_arm(primitive, actions)
        wait_s = self._docking.dock_s if isinstance(primitive, CloseDock) else self._docking.undock_s
        if not self._is_virtual(primitive.agent_id):
            wait_s = 0.0
        self._act_ms = now_ms + round(wait_s * 1000)
        self._deadline_ms = now_ms + round(self._docking.timeout_s * 1000)
        if self._act_ms == now_ms:
            self._apply(DockingEvent.WAIT_OVER, now_ms, actions)

    def _catches(self, agent_id: int) -> bool:
        """True for an aMussel within the catch radius, and for one that the bench does not catch itself."""
        if self._pose is None or not self._is_virtual(agent_id):
            return True
        distance_m = self._distance_m(agent_id, self._pose.north_m, self._pose.east_m)
        return distance_m is None or distance_m <= self._docking.catch_radius_m

    def _is_virtual(self, agent_id: int) -> bool:
        """A vehicle without a camera docks `camera` aMussels virtually, in the scenario's time."""
        profile = self._docking.profile_of(agent_id)
        return profile is DockingProfile.VIRTUAL or (
            profile is DockingProfile.CAMERA and not self._capabilities.sees_amussels
        )

    def _open_arm(self, primitive: CloseDock | OpenDock, actions: list[PortAction]) -> None:
        if (
            self._capabilities.moves_arms
            and self._is_virtual(primitive.agent_id)
            and self._docking.arm is ArmUse.MOVED
            and self._arm_dock is None
        ):
            self._arm_dock = primitive.dock_index
            actions.append(MoveArm(self._take_command_id(), primitive.dock_index, True))

    def _command_mechanism(self, actions: list[PortAction]) -> None:
        primitive = self.running
        assert isinstance(primitive, CloseDock | OpenDock)
        self._phase = DockingPhase.ACTING
        self._act_ms = None
        self._command_id = self._take_command_id()
        known_dock = dock_index_of(self.docked, primitive.agent_id)
        if isinstance(primitive, OpenDock) and known_dock is not None:
            primitive = replace(primitive, dock_index=known_dock)
        actions.append(replace(primitive, command_id=self._command_id))

    def _receive_answer(
        self, event: DockingEvent, command_id: int, now_ms: int, actions: list[PortAction], reason: str = ""
    ) -> None:
        """The vehicle answers one of our commands."""
        if command_id != self._command_id:
            self.dropped[f"{event.name.lower()}: not of the running primitive"] += 1
            return
        self._apply(event, now_ms, actions, reason)

    def _take_pose(self, pose: PoseReported, now_ms: int) -> None:
        if (reason := out_of_range(north_m=pose.north_m, east_m=pose.east_m)) is not None:
            self.dropped[f"pose: {reason}"] += 1
            return
        self._pose = pose
        if self._progress is not None:
            self._progress.take(pose, now_ms)

    def _take_dock(self, fact: DockClosed | DockOpened, now_ms: int, actions: list[PortAction]) -> None:
        if fact.dock_index not in self._capabilities.docks.indices:
            self.dropped["dock: no such dock"] += 1
            return
        closed = isinstance(fact, DockClosed)
        self.docked = after_report(self.docked, fact.dock_index, fact.agent_id, closed=closed)
        actions.append(DockChanged(fact.at_ms, fact.dock_index, fact.agent_id, closed, self.docked))
        wanted = CloseDock if closed else OpenDock
        if isinstance(self.running, wanted) and self.running.agent_id == fact.agent_id:
            self._apply(DockingEvent.MECHANISM_DONE, now_ms, actions)

    def _apply(self, event: DockingEvent, at_ms: int, actions: list[PortAction], reason: str = "") -> None:
        """Apply the table's effect of this event in the present phase."""
        if (effect := TABLE.get((self._phase, event))) is None:
            self.dropped[f"{event.name.lower()}: while {self._phase.name.lower()}"] += 1
        elif effect is Effect.ACT:
            self._command_mechanism(actions)
        elif effect is Effect.RETRY:
            self._try_again(event, at_ms, actions, reason)
        elif effect in (Effect.SUCCEED, Effect.FAIL, Effect.END_EMPTY):
            self._end(effect, event, at_ms, actions, reason)

    def _try_again(self, event: DockingEvent, at_ms: int, actions: list[PortAction], reason: str) -> None:
        primitive = self.running
        assert isinstance(primitive, CloseDock | OpenDock)
        self._first_cause = self._first_cause or reason
        if self._queued is not None or self._tries >= self._docking.attempts:
            self._end(Effect.FAIL, event, at_ms, actions, self._first_cause)
        else:
            self.dropped[f"a dock was tried again: {reason}"] += 1
            self._command_id = None
            self._start_mechanism(primitive, at_ms, actions)

    def _end(
        self, effect: Effect, event: DockingEvent, at_ms: int, actions: list[PortAction], reason: str
    ) -> None:
        ended, was_going = self.running, self._phase is DockingPhase.GOING
        assert ended is not None
        self._phase = DockingPhase.IDLE
        self.running = self._command_id = self._act_ms = self._deadline_ms = self._progress = None
        if effect is Effect.SUCCEED:
            actions.append(PrimitiveSucceeded(at_ms, ended.command_id))
            if not isinstance(ended, Hold):
                self.first_failure = None
        elif effect is Effect.END_EMPTY:
            actions.append(NothingCaught(at_ms, ended.command_id))
        else:
            failure = PrimitiveFailed(at_ms, ended.command_id, reason)
            actions.append(failure)
            if event is not DockingEvent.REPLACED and self.first_failure is None:
                self.first_failure = failure
        if was_going and event is DockingEvent.TIMED_OUT:
            self._hold_here(actions)
        if self._arm_dock is not None:
            actions.append(MoveArm(self._take_command_id(), self._arm_dock, False))
            self._arm_dock = None
        if self._queued is not None:
            queued, self._queued = self._queued, None
            self._start(queued, at_ms, actions)

    def _time_out_reason(self) -> str:
        if self._progress is not None:
            return self._progress.stall_reason()
        return f"the vehicle did not answer within {self._docking.timeout_s:g} s"

    def _hold_here(self, actions: list[PortAction]) -> None:
        """Stop a vehicle under way: field vehicles keep going to the old goal until the next command."""
        if self._pose is None:
            self.dropped["hold: the vehicle never sent a pose"] += 1
            return
        actions.append(Hold(self._take_command_id(), self._pose.north_m, self._pose.east_m))

    def _take_command_id(self) -> int:
        self._next_command_id += 1
        return self._next_command_id - 1
