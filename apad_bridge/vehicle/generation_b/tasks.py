"""Runs the tasks of a generation B aPad: one go-to, hold or visual docking at a time.

Each order has its tries and time-outs. A vehicle that dropped its order, or came to the end of a task, has its controllers
off: then the tasks ask for a hold (`HoldWanted`), and order none themselves. They order nothing while a pilot steers.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import replace

from apad_bridge.scenario.blocks.mission_options import Docking, DockingProfile
from apad_bridge.scenario.lab_interface.lab_messages import DockReport
from apad_bridge.vehicle.commands import (
    Arrived,
    CloseDock,
    CommandAccepted,
    CommandedByOthers,
    CommandFailed,
    GoalOfOthers,
    GoTo,
    Hold,
    HoldWanted,
    MoveArm,
    OpenDock,
    OrderCut,
    PilotLeft,
    PilotReported,
    PoseReported,
    Stop,
    VehicleCommand,
)
from apad_bridge.vehicle.generation_b.calls import OrderCalls
from apad_bridge.vehicle.generation_b.docks import KeptDocks
from apad_bridge.vehicle.generation_b.messages import (
    DockingOrder,
    PrimitiveStatus,
    ServiceAnswered,
    ServiceOrder,
)
from apad_bridge.vehicle.generation_b.primitives import GoToTask, HoldTask, ServoTask
from apad_bridge.vehicle.telemetry import Readings
from apad_bridge.vehicle.vehicle_link import Cleared, LinkFact

REPLACED = "another client's goal replaced it"
"""The reason of a go-to of ours that another client has ended."""
NOTHING_THERE = "the aPad reports a docking, but the aMussel is not there"
PILOT = "a pilot steers the aPad"


class ExternalDocking:
    """Follows dockings that nobody here ordered: a person's, or another planner's. They name no aMussel.

    The dock is the last dock whose arm opened. A full dock means an undocking, a free dock a docking.
    """

    def __init__(self) -> None:
        self.dropped: Counter[str] = Counter()
        self._dock: int | None = None
        self._since_ms: int | None = None
        """The time of the first RUNNING of the present docking; None without one."""

    @property
    def runs(self) -> bool:
        return self._since_ms is not None

    def is_left_alone(self, now_ms: int, timeout_s: float) -> bool:
        """A running docking is not cut short, for as long as a docking of ours may take."""
        return self._since_ms is not None and now_ms - self._since_ms < timeout_s * 1000

    def note_open_arm(self, dock_index: int) -> None:
        self._dock = dock_index

    def receive(self, status: PrimitiveStatus, at_ms: int, held: Mapping[int, int]) -> DockReport | None:
        """The change of a dock, when this message of `docking_status` ends a docking that was running."""
        if status is PrimitiveStatus.RUNNING:
            self._since_ms = at_ms if self._since_ms is None else self._since_ms
            return None
        ended, self._since_ms = self.runs, None
        if not ended or status is not PrimitiveStatus.DONE:
            return None
        if self._dock is None:
            self.dropped["docking by hand: no arm was seen to open"] += 1
            return None
        return DockReport(at_ms, None, self._dock, self._dock not in held)


class Tasks:
    """Sends orders through `calls`, reads poses from `readings`, returns results of commands from `take`."""

    def __init__(
        self, docking: Docking, docks: KeptDocks, readings: Readings, *, takes_back: bool = True
    ) -> None:
        self.calls = OrderCalls()
        self.pilot_steers = False
        """True until the vehicle, or a person, says that the pilot has let go."""
        self._pilot_is_known = True
        """False when nobody publishes the pilot's flag any more."""
        self._takes_back = takes_back
        """After a pilot it goes on with what it was ordered. Without that, a person gives the vehicle back."""
        self._docking = docking
        self._docks = docks
        self._readings = readings
        self._dropped: Counter[str] = Counter()
        self._facts: list[LinkFact] = []
        self._cleared: Cleared[VehicleCommand] | None = None
        """The newest command for which orders go out, as the gate let it out."""
        self._go_to_task: GoToTask | None = None
        self._servo_task: ServoTask | None = None
        self._hold_task: HoldTask | None = None
        self._stop: Stop | None = None
        """The order that switched the controllers off, until another command."""
        self._goal_m: tuple[float, float] | None = None
        """The last go-to's goal: the believed place of the aMussel."""
        self._external = ExternalDocking()
        self._is_quiet = False
        """Controllers are off, and no go-to runs: a later go-to is another client's."""

    @property
    def dropped(self) -> Counter[str]:
        return self._dropped + self._external.dropped

    def take(self) -> list[LinkFact]:
        """New facts, returned once."""
        facts, self._facts = self._facts, []
        return facts

    def command(self, cleared: Cleared[VehicleCommand], now_ms: int) -> None:
        command, servo = cleared.order, self._servo_task
        if isinstance(command, PilotLeft):
            # A person's word, and no news of the vehicle: what it reports would ask for another word.
            self.pilot_steers, self._pilot_is_known = False, True
            return
        is_stop = isinstance(command, Stop) or (isinstance(command, Hold) and command.pre_empts)
        if servo is not None and servo.has_let_go and not is_stop and not isinstance(command, MoveArm):
            servo.next_command = cleared
            return
        if self.pilot_steers and not self._takes_back:
            if not isinstance(command, MoveArm):
                self._facts.append(CommandFailed(now_ms, command.command_id, PILOT))
            return
        if not isinstance(command, MoveArm):
            self._stop = None
            # A hold that was wanted before this command would replace it.
            self._facts = [it for it in self._facts if not isinstance(it, HoldWanted)]
        if isinstance(command, GoTo | Hold | Stop) or self._is_servoed(command):
            self._cleared = cleared
        match command:
            case GoTo(_, north_m, east_m):
                self._goal_m = (north_m, east_m)
                self._go(command, now_ms)
            case Hold():
                self._hold(HoldTask(command, now_ms))
            case Stop():
                self._clear()
                self._stop, self._is_quiet = command, False
                self._order(command, now_ms)
            case CloseDock() | OpenDock() if self._is_servoed(command):
                self._begin_servo(command, now_ms)
            case OpenDock():
                self._facts += self._docks.open(command, now_ms)
            case CloseDock():
                # The port has waited out the docking time, and the bench makes the contact.
                self._facts += self._docks.close(command, self._pose, now_ms)

    def _is_servoed(self, command: VehicleCommand) -> bool:
        """True for a docking or an undocking by the vehicle's own visual servoing."""
        if not isinstance(command, CloseDock | OpenDock):
            return False
        return self._docking.profile_of(command.agent_id) is not DockingProfile.VIRTUAL

    def note_cut(self, cut: OrderCut) -> None:
        self._facts.append(cut)

    def receive_answer(self, answer: ServiceAnswered) -> None:
        """A service answers: the vehicle has taken the present order, or refuses it."""
        if not self.calls.receive(answer):
            return
        if self._hold_task is not None:
            self._hold_task.ordered_ms = answer.at_ms
        command = self._stop or self._commanded
        if isinstance(command, GoTo | Hold | Stop):
            self._facts.append(CommandAccepted(answer.at_ms, command.command_id))

    def receive_status(self, docking: bool, status: PrimitiveStatus, at_ms: int) -> None:
        pending = self.calls.pending
        answered = pending is not None and pending.answered_ms is not None
        if docking:
            if self._servo_task is None:
                self._receive_external(status, at_ms)
            elif self._servo_task.receive(status, at_ms, answered=answered):
                self._servo_done(self._servo_task, at_ms)
        elif self._go_to_task is not None and self._go_to_task.receive(
            status, at_ms, self._pose, answered=answered
        ):
            if self._go_to_task.is_near(self._pose):
                self._arrive(self._go_to_task.command, at_ms)
            else:
                distance_m = self._go_to_task.distance_m(self._pose)
                self._fail(f"the aPad reports an arrival, {distance_m:.1f} m from the goal", at_ms)
        elif self._go_to_task is not None and self._go_to_task.is_replaced and not self._takes_back:
            self._give_way(at_ms)
            self._facts.append(CommandedByOthers(at_ms))
        elif self._hold_task is not None and self._hold_task.receive_goto_status(
            status, at_ms, answered=answered
        ):
            self._dropped["goto_status: another client sent the aPad away from its hold"] += 1
            self._report_others(at_ms)
        elif self._stop is not None and answered:
            if status is PrimitiveStatus.RUNNING and self._is_quiet:
                self._report_others(at_ms)
            self._is_quiet = status is not PrimitiveStatus.RUNNING

    def _receive_external(self, status: PrimitiveStatus, at_ms: int) -> None:
        """Lets a docking that nobody here ordered end; it then leaves the controllers off."""
        did_run = self._external.runs
        if (report := self._external.receive(status, at_ms, self._docks.held)) is not None:
            self.receive_dock_report(report)
        if did_run and not self._external.runs and self._hold_task is not None:
            self._hold_task.is_lost = True

    def receive_arm(self, dock_index: int, at_ms: int) -> None:
        """The arm of `dock_index` opened. An undocking lets its aMussel go then."""
        self._external.note_open_arm(dock_index)
        servo = self._servo_task
        if servo is None or servo.has_let_go or not isinstance(servo.command, OpenDock):
            return
        if servo.command.dock_index == dock_index:
            servo.has_let_go = True
            self._facts += self._docks.open(servo.command, at_ms)

    def receive_dock_report(self, report: DockReport) -> None:
        self._facts += self._docks.apply_report(report, self._pose)

    def receive_others_goal(self, goal: GoalOfOthers) -> None:
        """Another client sends the vehicle away: a go-to of ours has ended there, and its status is not ours any more."""
        self._give_way(goal.at_ms)
        self._facts += [goal, CommandedByOthers(goal.at_ms, goal.client)]

    def _give_way(self, at_ms: int) -> None:
        """A go-to of ours, if one is under way, has ended by another client's."""
        if self._go_to_task is not None:
            self._facts.append(CommandFailed(at_ms, self._go_to_task.command.command_id, REPLACED))
            self.calls.forget()
            self._clear()

    def _report_others(self, at_ms: int) -> None:
        if not self._takes_back:
            self._facts.append(CommandedByOthers(at_ms))

    def receive_pilot(self, steers: bool | None, at_ms: int) -> None:
        """A pilot takes or leaves the controls. The bridge never fights a pilot: it fails the running command and waits.

        None: the node that published the flag is gone. A pilot who steered steers on, and of another nobody can tell.
        """
        was_known, self._pilot_is_known = self._pilot_is_known, steers is not None
        if steers is None and not self.pilot_steers and was_known:
            self._facts.append(PilotReported(at_ms, None))
        if steers is False and not was_known and not self.pilot_steers:
            self._facts.append(PilotReported(at_ms, False))
        if steers is None or steers == self.pilot_steers:
            return
        self.pilot_steers = steers
        if not self._takes_back:
            self._leave_to_pilot(at_ms)
        elif steers:
            self.calls.forget()
            if (command := self._under_way) is not None:
                self._facts.append(CommandFailed(at_ms, command.command_id, PILOT))
                self._clear()
        elif self._go_to_task is not None:
            self._go(self._go_to_task.command, at_ms)
        elif self._servo_task is not None:
            self._order(self._servo_task.first_order, at_ms)
        elif self._hold_task is not None:
            self._want_again(self._hold_task, at_ms)
        else:
            self._hold_here(at_ms)

    def _leave_to_pilot(self, at_ms: int) -> None:
        """A pilot takes the controls, or lets go of them, which is not yet a person's word to go on."""
        self.calls.forget()
        if (command := self._commanded) is not None:
            self._facts.append(CommandFailed(at_ms, command.command_id, PILOT))
        self._clear()
        self._stop = None
        self._facts.append(PilotReported(at_ms, self.pilot_steers))
        if self.pilot_steers:
            self._facts.append(CommandedByOthers(at_ms))

    def resend(self, now_ms: int) -> None:
        """Repeats an order that a rebooted vehicle may have forgotten. A docking has its own time-out.

        A vehicle that is a person's to give back gets none: somebody may have hands on it by now.
        """
        if not self._takes_back:
            return
        if self._go_to_task is not None:
            self._go(self._go_to_task.command, now_ms)
        elif self._hold_task is not None:
            self._want_again(self._hold_task, now_ms)

    def watch(self, now_ms: int) -> None:
        """Ends tasks by time-out, by silence, or by the vehicle's position."""
        if (cause := self.calls.retry_or_fail(now_ms)) is not None:
            if self._stop is not None:
                self._facts.append(CommandFailed(now_ms, self._stop.command_id, cause))
            else:
                self._fail(cause, now_ms)
        if self._go_to_task is not None:
            self._watch_go_to(self._go_to_task, now_ms)
        elif self._servo_task is not None:
            self._watch_servo(self._servo_task, now_ms)
        elif self._hold_task is not None and self._must_hold_again(self._hold_task, now_ms):
            self._dropped["the aPad did not hold its position, and got the hold again"] += 1
            self._want_again(self._hold_task, now_ms)

    def _must_hold_again(self, task: HoldTask, now_ms: int) -> bool:
        """Another party's order is not cut short, for as long as a docking of ours may take."""
        timeout_s = self._docking.timeout_s
        if task.is_left_alone(now_ms, timeout_s) or self._external.is_left_alone(now_ms, timeout_s):
            return False
        return task.is_astray(self._pose, now_ms)

    @property
    def _pose(self) -> PoseReported | None:
        return self._readings.pose

    @property
    def _under_way(self) -> GoTo | CloseDock | OpenDock | None:
        if self._go_to_task is not None:
            return self._go_to_task.command
        return None if self._servo_task is None else self._servo_task.command

    @property
    def _commanded(self) -> GoTo | CloseDock | OpenDock | Hold | None:
        held = None if self._hold_task is None else self._hold_task.command
        return self._under_way or held

    def _order(self, order: ServiceOrder, now_ms: int) -> None:
        assert self._cleared is not None, "an order stands for a command"
        if not self.pilot_steers:
            order = order if isinstance(order, DockingOrder) else replace(order, command_id=0)
            self.calls.order(order, self._cleared, now_ms)

    def _clear(self) -> None:
        """Forgets the present task and hold."""
        self._go_to_task = self._servo_task = self._hold_task = None

    def _fail(self, reason: str, at_ms: int) -> None:
        """Reports the present command as failed, and asks for a hold where the vehicle is."""
        if (command := self._commanded) is not None:
            self._facts.append(CommandFailed(at_ms, command.command_id, reason))
        self._hold_here(at_ms)

    # Holding.

    def _hold(self, task: HoldTask) -> None:
        self._clear()
        self._hold_task = task
        self._order(task.command, task.ordered_ms)

    def _want_again(self, task: HoldTask, now_ms: int) -> None:
        self._hold_task, held = HoldTask(task.command, now_ms), task.command
        self._facts.append(HoldWanted(now_ms, held.north_m, held.east_m, held.heading_rad))

    def _hold_here(self, now_ms: int) -> None:
        """Asks for a hold at the present position, because the end of a task leaves the controllers off."""
        self._clear()
        self.calls.forget()
        if self._pose is not None:
            self._facts.append(HoldWanted(now_ms, self._pose.north_m, self._pose.east_m))

    # Going.

    def _go(self, command: GoTo, now_ms: int) -> None:
        self._clear()
        self._go_to_task = GoToTask(command)
        self._order(command, now_ms)

    def _watch_go_to(self, task: GoToTask, now_ms: int) -> None:
        if (why := task.why_lost(now_ms)) is not None:
            self._fail(why, now_ms)
        elif task.has_arrived_unreported(self._pose, now_ms):
            self._dropped["goto_status was silent: arrival by position"] += 1
            self._arrive(task.command, now_ms)

    def _arrive(self, command: GoTo, at_ms: int) -> None:
        self._clear()
        self.calls.forget()
        self._facts += [
            Arrived(at_ms, command.command_id),
            HoldWanted(at_ms, command.north_m, command.east_m),
        ]

    # Visual docking.

    def _begin_servo(self, command: CloseDock | OpenDock, now_ms: int) -> None:
        refusal = self._docks.refusal(command) if isinstance(command, CloseDock) else None
        if self._docking.servo is None:
            refusal = "mission.docking.servo is missing in the scenario"
        if refusal is not None or self._docking.servo is None:
            self._facts.append(CommandFailed(now_ms, command.command_id, refusal or ""))
            return
        self._clear()
        self._servo_task = ServoTask(command, self._docking.servo, self._pose, self._goal_m, now_ms)
        self._order(self._servo_task.first_order, now_ms)

    def _watch_servo(self, servo: ServoTask, now_ms: int) -> None:
        pending = self.calls.pending
        answered_ms = None if pending is None else pending.answered_ms
        if (order := servo.next_order(self._pose, answered_ms, now_ms)) is not None:
            self._order(order, now_ms)
        elif (why := servo.why_over(answered_ms, now_ms)) is not None and servo.has_let_go:
            self._servo_done(servo, now_ms)
        elif why is not None:
            self._fail(why, now_ms)

    def _servo_done(self, servo: ServoTask, at_ms: int) -> None:
        if isinstance(servo.command, CloseDock):
            if self._docks.is_out_of_reach(servo.command, self._pose, at_ms):
                self._fail(NOTHING_THERE, at_ms)
                return
            if not self._docks.holds(servo.command.agent_id):
                self._facts += self._docks.close(servo.command, self._pose, at_ms)
        elif not servo.has_let_go:
            self._facts += self._docks.open(servo.command, at_ms)
        self._clear()
        if servo.next_command is None:
            self._hold_here(at_ms)
        else:
            self.command(servo.next_command, at_ms)
