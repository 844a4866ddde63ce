"""Turns the port's commands into orders for a generation B aPad, and its messages into facts. No ROS, no clock.

That stack answers at once and reports the end on topics that name no order. Nothing in it has a time-out, and
every end leaves the controllers off. `Tasks` keeps the orders and works out their state.
"""

from __future__ import annotations

import math
from collections import Counter, deque

from apad_bridge.scenario.blocks.mission_options import Docking
from apad_bridge.scenario.lab_interface.lab_messages import DockReport
from apad_bridge.vehicle.commands import (
    CloseDock,
    GoalOfOthers,
    GoTo,
    OpenDock,
    OrderCut,
    PoseReported,
    VehicleCommand,
)
from apad_bridge.vehicle.generation_b.docks import KeptDocks
from apad_bridge.vehicle.generation_b.messages import (
    ArmReceived,
    DockingOrder,
    ManualReceived,
    NumberedOrder,
    Received,
    ServiceAnswered,
    ServiceOrder,
    StatusReceived,
)
from apad_bridge.vehicle.generation_b.tasks import Tasks
from apad_bridge.vehicle.guards.gate import Gate
from apad_bridge.vehicle.stack_messages import BatteryReceived, StateRefReceived
from apad_bridge.vehicle.telemetry import DeferredMessages, Readings, SilenceWatch
from apad_bridge.vehicle.vehicle_link import Cleared, LinkFact

OWN_GOALS = 16
"""So many of our newest go-tos are known again when the vehicle's own server is shown them."""
SAME_PLACE_M = 0.01
"""The commander passes an order's place on unchanged, in the same type."""


class GenerationBCore:
    """`receive` takes a message, `command` a port's command, `advance` returns the facts stamped up to its time.

    `take_calls` returns the calls to send to the vehicle's services. `battery_v` is (empty, full); `docks` are kept for the
    vehicle; `gate` judges each call. A core that `takes_back` its vehicle goes on by itself when a pilot lets go; any other
    reports `CommandedByOthers`, and waits.
    """

    def __init__(
        self,
        docks: KeptDocks,
        battery_v: tuple[float, float],
        docking: Docking,
        now_ms: int = 0,
        *,
        takes_back: bool = True,
        gate: Gate | None = None,
    ) -> None:
        self._gate = gate or Gate.without_guards()
        self._now_ms = now_ms
        self.readings = Readings(battery_v)
        self.docks = docks
        self.status_count = 0
        """Number of messages of either status topic."""
        self._tasks = Tasks(docking, docks, self.readings, takes_back=takes_back)
        self._deferred: DeferredMessages[Received] = DeferredMessages(now_ms, self.readings.dropped)
        self._silence = SilenceWatch()
        self._takes_back = takes_back
        self._own_goals_m: deque[tuple[float, float]] = deque(maxlen=OWN_GOALS)
        """The places of the newest go-tos that the gate let out. Their goals have the commander's key, as all others."""

    @property
    def dropped(self) -> Counter[str]:
        """Unusable messages of the vehicle, by reason."""
        return self.readings.dropped + self.docks.dropped + self._tasks.dropped

    @property
    def unacknowledged(self) -> list[str]:
        """The last order, until its service answers."""
        return self._tasks.calls.unanswered

    def silent_topics(self, now_ms: int) -> list[str]:
        return ["position"] if self.readings.position_ms < now_ms else []

    def take_calls(self) -> list[Cleared[NumberedOrder]]:
        """Asks the gate about each call, whoever wants it. A call that it refuses fails as if the aPad refused it."""
        calls = []
        for call in self._tasks.calls.take():
            cleared = self._gate.clear_for_wire(call, _as_command(call.order), call.before, self._now_ms)
            if cleared is not None:
                calls.append(cleared)
                if isinstance(call.order, GoTo):
                    self._own_goals_m.append((call.order.north_m, call.order.east_m))
            else:
                self._tasks.calls.receive(ServiceAnswered(self._now_ms, call.number, "a guard refused it"))
        return calls

    def command(self, cleared: Cleared[VehicleCommand], now_ms: int) -> None:
        self._now_ms = now_ms
        self._tasks.command(cleared, now_ms)

    def receive(self, message: Received, now_ms: int) -> None:
        """Takes a message; one stamped after `now_ms` waits for its time."""
        if self._deferred.defers(message, now_ms):
            return
        match message:
            case PoseReported() | StateRefReceived() | BatteryReceived():
                self.readings.receive(message)
            case ServiceAnswered():
                self._tasks.receive_answer(message)
            case OrderCut():
                self._tasks.note_cut(message)
            case StatusReceived(at_ms, docking, status):
                self.status_count += 1
                self._tasks.receive_status(docking, status, at_ms)
            case ManualReceived(at_ms, steers):
                self._tasks.receive_pilot(steers, at_ms)
            case GoalOfOthers():
                self._see_goal(self.readings.usable_goal(message, "go2point/goal"))
            case ArmReceived(at_ms, dock_index):
                self._tasks.receive_arm(dock_index, at_ms)

    def _see_goal(self, goal: GoalOfOthers) -> None:
        """Takes a goal on its way to the vehicle's server; another client's is for the guards to judge.

        A client that sends the vehicle to a place of ours sends it where the gate has let us go.
        """
        if not self._takes_back and not self._is_own_place(goal.north_m, goal.east_m):
            self._tasks.receive_others_goal(goal)

    def _is_own_place(self, north_m: float | None, east_m: float | None) -> bool:
        if north_m is None or east_m is None:
            return False
        return any(math.dist((north_m, east_m), it) <= SAME_PLACE_M for it in self._own_goals_m)

    def receive_dock_report(self, report: DockReport) -> None:
        """Takes a report that a dock closed or opened, by id or else by dock and place. Known states change nothing."""
        self._tasks.receive_dock_report(report)

    def advance(self, now_ms: int) -> list[LinkFact]:
        """New facts, each stamped at or before `now_ms`; of poses and places only the newest."""
        self._now_ms = now_ms
        for message in self._deferred.advance(now_ms):
            self.receive(message, now_ms)
        if not self._tasks.pilot_steers:
            if self._silence.look(self.readings.position_ms, now_ms) and not self._silence.is_silent:
                self._tasks.resend(now_ms)
            self._tasks.watch(now_ms)
        readings = self.readings.take(self._gate)
        return [*self._tasks.take(), *self.docks.places(self.readings.pose, now_ms), *readings]


def _as_command(order: ServiceOrder) -> VehicleCommand:
    """The command that guards judge."""
    if not isinstance(order, DockingOrder):
        return order
    return (CloseDock if order.docks else OpenDock)(0, order.dock_index, order.agent_id)
