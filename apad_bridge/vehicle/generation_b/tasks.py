"""What an aPad of generation B was told to do, and how it goes: one go-to, hold or docking by its own eyes at a time.

Each order has its tries and its time-outs, a vehicle that dropped one is noticed, and whatever ends is followed by dynamic
positioning. While a pilot steers nothing is ordered.

Dockings of generation B that nobody here ordered: by a person's hand, or another's planner. They name no aMussel.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping

from apad_bridge.scenario.lab_interface.messages import DockSaid
from apad_bridge.scenario.schema import Docking, DockingProfile
from apad_bridge.vehicle.commands import (
    Arrived,
    CloseDock,
    CommandFailed,
    GoTo,
    Hold,
    MoveArm,
    OpenDock,
    PoseReported,
    VehicleCommand,
)
from apad_bridge.vehicle.generation_b.calls import Calls
from apad_bridge.vehicle.generation_b.docks import DocksByBench
from apad_bridge.vehicle.generation_b.messages import Order, PositionOrder, Status
from apad_bridge.vehicle.generation_b.primitives import Going, Holding, ServoDocking, holding_of
from apad_bridge.vehicle.link import LinkFact
from apad_bridge.vehicle.telemetry import Readings


class HandDocking:
    """Its slot is the one whose arm was last seen to open; whether it docks or undocks follows from what the slot holds."""

    def __init__(self) -> None:
        self.dropped: Counter[str] = Counter()
        self._dock: int | None = None
        self._since_ms: int | None = None
        """When one was first heard to run that was not heard to end."""

    @property
    def runs(self) -> bool:
        return self._since_ms is not None

    def is_left_alone(self, now_ms: int, timeout_s: float) -> bool:
        """One that runs is not cut short, for as long as a docking of ours would have."""
        return self._since_ms is not None and now_ms - self._since_ms < timeout_s * 1000

    def see_arm(self, dock_index: int) -> None:
        self._dock = dock_index

    def hear(self, status: Status, at_ms: int, held: Mapping[int, int]) -> DockSaid | None:
        """What a word on `docking_status` tells of a dock, when it ends a docking that was seen to run."""
        if status is Status.RUNNING:
            self._since_ms = at_ms if self._since_ms is None else self._since_ms
            return None
        ended, self._since_ms = self.runs, None
        if not ended or status is not Status.DONE:
            return None
        if self._dock is None:
            self.dropped["docking by hand: no arm was seen to open"] += 1
            return None
        return DockSaid(at_ms, None, self._dock, self._dock not in held)


NOTHING_THERE = "the aPad says it docked, but the aMussel is not there"
PILOT = "a pilot steers the aPad"


class Tasks:
    """Orders go to `calls`; what became of the commands is in `take`. Poses are read from `readings`."""

    def __init__(self, docking: Docking, docks: DocksByBench, readings: Readings) -> None:
        self.calls = Calls()
        self.pilot_steers = False
        self._docking = docking
        self._docks = docks
        self._readings = readings
        self._dropped: Counter[str] = Counter()
        self._facts: list[LinkFact] = []
        self._going: Going | None = None
        self._servo: ServoDocking | None = None
        self._holding: Holding | None = None
        self._goal_m: tuple[float, float] | None = None
        """Where the last go-to led: there the aMussel was believed to be."""
        self._hand = HandDocking()

    @property
    def dropped(self) -> Counter[str]:
        return self._dropped + self._hand.dropped

    def take(self) -> list[LinkFact]:
        """What became true, told once."""
        facts, self._facts = self._facts, []
        return facts

    def command(self, command: VehicleCommand, now_ms: int) -> None:
        if self._servo is not None and self._servo.has_let_go and not isinstance(command, MoveArm):
            self._servo.waits = command
            return
        match command:
            case GoTo(_, north_m, east_m):
                self._goal_m = (north_m, east_m)
                self._go(command, now_ms)
            case Hold():
                self._hold(holding_of(command, now_ms))
            case MoveArm():  # the link's: nothing is answered
                pass
            case CloseDock(_, _, agent_id) | OpenDock(_, _, agent_id):
                if self._docking.profile_of(agent_id) is not DockingProfile.VIRTUAL:
                    self._begin_servo(command, now_ms)
                elif isinstance(command, OpenDock):
                    self._facts += self._docks.open(command, now_ms)
                else:
                    # The port has waited out the time, and the bench makes the contact.
                    self._facts += self._docks.close(command, self._pose, now_ms)

    def hear_status(self, docking: bool, status: Status, at_ms: int) -> None:
        pending = self.calls.pending
        answered = pending is not None and pending.answered_ms is not None
        if docking:
            if self._servo is None:
                self._hear_hand(status, at_ms)
            elif self._servo.hear(status, at_ms, answered=answered):
                self._servo_done(self._servo, at_ms)
        elif self._going is not None and self._going.hear(status, at_ms, self._pose, answered=answered):
            if self._going.is_near(self._pose):
                self._arrive(self._going.command, at_ms)
            else:
                distance_m = self._going.distance_m(self._pose)
                self._fail(f"the aPad says it arrived, {distance_m:.1f} m from the goal", at_ms)
        elif self._holding is not None and self._holding.hear_going(status, at_ms, answered=answered):
            self._dropped["goto_status: somebody else sent the aPad away from where it shall hold"] += 1

    def _hear_hand(self, status: Status, at_ms: int) -> None:
        """A docking that nobody here ordered: it is let end, and has then left the controllers off."""
        did_run = self._hand.runs
        if (word := self._hand.hear(status, at_ms, self._docks.held)) is not None:
            self.hear_dock(word)
        if did_run and not self._hand.runs and self._holding is not None:
            self._holding.is_lost = True

    def hear_arm(self, dock_index: int, at_ms: int) -> None:
        """The arm of `dock_index` was seen to open: of an undocking it lets go."""
        self._hand.see_arm(dock_index)
        servo = self._servo
        if servo is None or servo.has_let_go or not isinstance(servo.command, OpenDock):
            return
        if servo.command.dock_index == dock_index:
            servo.has_let_go = True
            self._facts += self._docks.open(servo.command, at_ms)

    def hear_dock(self, word: DockSaid) -> None:
        self._facts += self._docks.take_word(word, self._pose)

    def hear_pilot(self, steers: bool, at_ms: int) -> None:
        """A pilot is never fought: what was under way has failed, and nothing is ordered until the sticks are let go."""
        if steers == self.pilot_steers:
            return
        self.pilot_steers = steers
        if steers:
            self.calls.forget()
            if (command := self._under_way) is not None:
                self._facts.append(CommandFailed(at_ms, command.command_id, PILOT))
                self._begin()
        elif self._going is not None:
            self._go(self._going.command, at_ms)
        elif self._servo is not None:
            self._order(self._servo.first_order, at_ms)
        elif self._holding is not None and self._holding.command is not None:
            self._hold(holding_of(self._holding.command, at_ms))
        else:
            self._hold_here(at_ms)

    def tell_again(self, now_ms: int) -> None:
        """The vehicle may have been rebooted, and know of nothing any more. A docking has its own time-out."""
        if self._going is not None:
            self._go(self._going.command, now_ms)
        elif self._holding is not None:
            self._hold_again(self._holding, now_ms)

    def watch(self, now_ms: int) -> None:
        """What is over by its time, by silence, or by where the vehicle is."""
        if (cause := self.calls.failed(now_ms)) is not None:
            if self._commanded is not None:
                self._fail(cause, now_ms)
            else:
                self._dropped[f"hold after the end of a primitive: {cause}"] += 1
                if self._holding is not None:
                    self._holding.told_ms = now_ms
        if self._going is not None:
            self._watch_going(self._going, now_ms)
        elif self._servo is not None:
            self._watch_servo(self._servo, now_ms)
        elif self._holding is not None and self._shall_hold_again(self._holding, now_ms):
            self._dropped["the aPad did not hold its position, and was told again"] += 1
            self._hold_again(self._holding, now_ms)

    def _shall_hold_again(self, holding: Holding, now_ms: int) -> bool:
        """What another ordered is not cut short, for as long as a docking of ours would have."""
        timeout_s = self._docking.timeout_s
        if holding.is_left_alone(now_ms, timeout_s) or self._hand.is_left_alone(now_ms, timeout_s):
            return False
        return holding.is_astray(self._pose, now_ms)

    @property
    def _pose(self) -> PoseReported | None:
        return self._readings.pose

    @property
    def _under_way(self) -> GoTo | CloseDock | OpenDock | None:
        if self._going is not None:
            return self._going.command
        return None if self._servo is None else self._servo.command

    @property
    def _commanded(self) -> GoTo | CloseDock | OpenDock | Hold | None:
        held = None if self._holding is None else self._holding.command
        return self._under_way or held

    def _order(self, order: Order, now_ms: int) -> None:
        if not self.pilot_steers:
            self.calls.order(order, now_ms)

    def _begin(self) -> None:
        """Nothing is under way, and nothing held."""
        self._going = self._servo = self._holding = None

    def _fail(self, reason: str, at_ms: int) -> None:
        """The command under way has failed; the vehicle is held where it is."""
        if (command := self._commanded) is not None:
            self._facts.append(CommandFailed(at_ms, command.command_id, reason))
        self._hold_here(at_ms)

    # Holding.

    def _hold(self, holding: Holding) -> None:
        self._begin()
        self._holding = holding
        self._order(holding.order, holding.told_ms)

    def _hold_again(self, holding: Holding, now_ms: int) -> None:
        self._order(holding.tell_again(now_ms), now_ms)

    def _hold_here(self, now_ms: int) -> None:
        """Whatever ended left the controllers off."""
        self._begin()
        if self._pose is not None:
            self._hold(Holding(PositionOrder(self._pose.north_m, self._pose.east_m), now_ms))

    # Going.

    def _go(self, command: GoTo, now_ms: int) -> None:
        self._begin()
        self._going = Going(command)
        if (order := self._going.order) is None:
            self._fail("the aPad aborts a go-to without a speed, a victory radius or a finite goal", now_ms)
        else:
            self._order(order, now_ms)

    def _watch_going(self, going: Going, now_ms: int) -> None:
        if (why := going.why_lost(now_ms)) is not None:
            self._fail(why, now_ms)
        elif going.has_arrived_unsaid(self._pose, now_ms):
            self._dropped["goto_status was silent: arrival by position"] += 1
            self._arrive(going.command, now_ms)

    def _arrive(self, command: GoTo, at_ms: int) -> None:
        self._facts.append(Arrived(at_ms, command.command_id))
        self._hold(Holding(PositionOrder(command.north_m, command.east_m), at_ms))

    # Docking by its own eyes.

    def _begin_servo(self, command: CloseDock | OpenDock, now_ms: int) -> None:
        refused = self._docks.refusal(command) if isinstance(command, CloseDock) else None
        if self._docking.servo is None:
            refused = "mission.docking.servo is missing in the scenario"
        if refused is not None or self._docking.servo is None:
            self._facts.append(CommandFailed(now_ms, command.command_id, refused or ""))
            return
        self._begin()
        self._servo = ServoDocking(command, self._docking.servo, self._pose, self._goal_m, now_ms)
        self._order(self._servo.first_order, now_ms)

    def _watch_servo(self, servo: ServoDocking, now_ms: int) -> None:
        pending = self.calls.pending
        answered_ms = None if pending is None else pending.answered_ms
        order = servo.next_order(self._pose, answered_ms, now_ms)
        if order is not None:
            self._order(order, now_ms)
        elif (why := servo.why_over(answered_ms, now_ms)) is not None and servo.has_let_go:
            self._servo_done(servo, now_ms)
        elif why is not None:
            self._fail(why, now_ms)

    def _servo_done(self, servo: ServoDocking, at_ms: int) -> None:
        if isinstance(servo.command, CloseDock):
            if self._docks.is_out_of_reach(servo.command, self._pose, at_ms):
                self._fail(NOTHING_THERE, at_ms)
                return
            if not self._docks.holds(servo.command.agent_id):
                self._facts += self._docks.close(servo.command, self._pose, at_ms)
        elif not servo.has_let_go:
            self._facts += self._docks.open(servo.command, at_ms)
        self._begin()
        if servo.waits is None:
            self._hold_here(at_ms)
        else:
            self.command(servo.waits, at_ms)
