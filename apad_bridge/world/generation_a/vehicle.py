"""The simulated aPad with generation A's behaviour, without ROS: goals in, messages to publish out.

It copies the published stack as observed on a running graph, surprises included: a perch requires no nearness
and takes the first free dock, a perch without a free dock succeeds and does nothing, a cancelled go-to keeps moving, and a
goal of an unknown kind stays active for ever. A goal of generation A carries neither speed nor victory
radius: both are settings of this vehicle. One behaviour is ours: with `misses`, a perch may abort because the
mechanism missed.

The controllers are copied by their source, not from a running graph. `FADP` turns a place into a velocity, and the
velocity controller turns a velocity into thrust on each axis that is set to control. With either off there is no
thrust: drag stops the vehicle, and the water carries it along. `VelCon_enable` false disables every axis, true changes
nothing; `ConfigureVelocityController` sets the axes. A go-to turns both controllers on.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence

from apad_bridge.beliefs.input_ranges import out_of_range
from apad_bridge.scenario.faults import Fault
from apad_bridge.vehicle.commands import (
    Arrived,
    CloseDock,
    CommandFailed,
    GoTo,
    Hold,
    OpenDock,
    VehicleFact,
)
from apad_bridge.vehicle.generation_a.messages import GO_TO, OBJECT_PREFIX, PERCH, RELEASE, GoalOrder
from apad_bridge.world.apad.dock_mechanisms import MISSED, Misses
from apad_bridge.world.apad.motion import Coast
from apad_bridge.world.apad.simulated_apad import SimulatedAPad
from apad_bridge.world.generation_a.simulated_messages import (
    BatteryAndProgressPublished,
    GoalEnded,
    GoalOutcome,
    HeldPositionPublished,
    Published,
)
from apad_bridge.world.simulated_stack import PosePublished, SimulatedStack

HELD_PERIOD_MS = 50
POSE_PERIOD_MS = 100
SLOW_PERIOD_MS = 1000
"""Period of battery, feedback and goal status."""
CONTROL_AXIS, KEEP_AXIS = 2, -1
"""Modes of an axis of the velocity controller: controlled, and left as it is."""
_AGENT_NUMBER = re.compile(r"\d+$", re.ASCII)


class GenerationAVehicle(SimulatedStack[Published]):
    """The simulated stack of generation A. It has the three verbs in mission time, from `start_ms` on."""

    def __init__(
        self,
        apad: SimulatedAPad,
        speed_m_s: float,
        victory_radius_m: float,
        start_ms: int = 0,
        fault: Fault = Fault.NONE,
        misses: Misses | None = None,
    ) -> None:
        super().__init__(apad, start_ms, HELD_PERIOD_MS, fault)
        self.has_crashed = False
        self._speed_m_s = speed_m_s
        self._victory_radius_m = victory_radius_m
        self._misses = misses
        self._goal: GoalOrder | None = None
        self._start_distance_m = 0.0
        self._reference: GoTo | Hold = Hold(0, apad.pose.north_m, apad.pose.east_m)
        """The place to which the controllers steer, whether a goal runs or not."""
        self._has_position_control = True
        self._axes = [CONTROL_AXIS, CONTROL_AXIS]
        """The modes of surge and sway."""
        self._docks = {index: (f"{OBJECT_PREFIX}{held}", held) for index, held in apad.docked.items()}
        """(object, serial of its perch) by dock index; of one held at the start, its id in place of the serial."""
        self._serial = max(apad.docked.values(), default=0)

    @property
    def free_docks(self) -> list[int]:
        return [dock_index for dock_index in self.dock_indices if dock_index not in self._docks]

    @property
    def held(self) -> list[str]:
        """The held objects in the order of dock indices, without free docks."""
        return [self._docks[dock_index][0] for dock_index in sorted(self._docks)]

    def receive(self, goal: GoalOrder, now_ms: int) -> list[Published]:
        """A new goal pre-empts the running one, whatever its kind."""
        published = self.advance(now_ms)
        if self.has_crashed:
            self.dropped["goal: the action server has crashed"] += 1
            return published
        published += self._end(GoalOutcome.PREEMPTED, "a new goal came")
        self._goal = goal
        if goal.kind == GO_TO:
            return published + self._go_to(goal)
        if goal.kind == PERCH:
            return published + self._perch(goal)
        if goal.kind == RELEASE:
            return published + self._release(goal)
        self.dropped["goal: of no known kind, active for ever"] += 1
        return published

    def cancel(self, key: str, now_ms: int) -> list[Published]:
        """Ends the goal; the vehicle still moves to the old target."""
        published = self.advance(now_ms)
        if self._goal is not None and self._goal.key == key and not self.has_crashed:
            published += self._end(GoalOutcome.PREEMPTED, "cancelled")
        return published

    def enable_position_control(self, enabled: bool, now_ms: int) -> list[Published]:
        """`FADP_enable`."""
        published, had_thrust = self.advance(now_ms), self.has_thrust
        self._has_position_control = enabled
        return published + self._change_thrust(had_thrust)

    def enable_velocity_control(self, enabled: bool, now_ms: int) -> list[Published]:
        """`VelCon_enable`: false disables every axis; true changes nothing."""
        return self.advance(now_ms) if enabled else self.configure_axes([0, 0], now_ms)

    def configure_axes(self, modes: Sequence[int], now_ms: int) -> list[Published]:
        """`ConfigureVelocityController`. `modes` begin with surge and sway."""
        published, had_thrust = self.advance(now_ms), self.has_thrust
        self._axes = [old if new == KEEP_AXIS else new for old, new in zip(self._axes, modes, strict=False)]
        return published + self._change_thrust(had_thrust)

    @property
    def has_thrust(self) -> bool:
        """True while the controllers steer to the reference."""
        return self._has_position_control and self._axes == [CONTROL_AXIS, CONTROL_AXIS]

    def _change_thrust(self, had_thrust: bool) -> list[Published]:
        """Controllers that go off leave a running goal active; controllers that come on steer to the old reference."""
        if self.has_thrust is had_thrust:
            return []
        command = self._reference if self.has_thrust else Coast()
        return self._goal_end(self._apad.receive(command, self._apad_ms))

    def set_dock(self, dock_index: int, closed: bool, now_ms: int) -> list[Published]:
        """A person operates a mechanism. A refusal is a ValueError with its reason and changes nothing."""
        if dock_index not in self.dock_indices:
            raise ValueError(f"there is no dock {dock_index}")
        if closed:
            raise ValueError("a dock closes by a perch, which names what it holds")
        if dock_index not in self._docks:
            raise ValueError(f"dock {dock_index} is open")
        return [*self.advance(now_ms), self._let_go(dock_index)]

    def change_battery(self, percent_points: float, now_ms: int) -> list[Published]:
        """`charging`, or `draining` with a minus sign. A number out of range changes nothing."""
        published = self.advance(now_ms)
        if (reason := out_of_range(percent_points=percent_points)) is None:
            self._apad.change_battery(percent_points / 100, now_ms - self._start_ms)
        else:
            self.dropped[f"charging or draining: {reason}"] += 1
        return published

    def _go_to(self, goal: GoalOrder) -> list[Published]:
        pose = self._apad.pose
        self._start_distance_m = math.hypot(goal.north_m - pose.north_m, goal.east_m - pose.east_m)
        if self._fault is Fault.STUCK:
            return []
        self._has_position_control, self._axes = True, [CONTROL_AXIS, CONTROL_AXIS]
        self._reference = GoTo(
            self._next_serial(), goal.north_m, goal.east_m, self._speed_m_s, self._victory_radius_m
        )
        published = self._goal_end(self._apad.receive(self._reference, self._apad_ms))
        if self._fault is Fault.SERVER_DIES:
            self.has_crashed, self._goal = True, None
        return published

    def _perch(self, goal: GoalOrder) -> list[Published]:
        free = self.free_docks
        if not free or self._fault is Fault.PERCHES_NOTHING:
            return self._end(GoalOutcome.SUCCEEDED)
        number = _AGENT_NUMBER.search(goal.name)
        place_m = self.pose.north_m, self.pose.east_m
        if (
            self._misses is not None
            and number is not None
            and self._misses.misses(int(number[0]), place_m, self._apad_ms)
        ):
            return self._end(GoalOutcome.ABORTED, MISSED)
        dock_index, serial = free[0], self._next_serial()
        if failed := self._goal_end(self._apad.receive(CloseDock(serial, dock_index, serial), self._apad_ms)):
            return failed
        self._docks[dock_index] = (goal.name, serial)
        return [self._held(dock_index), *self._end(GoalOutcome.SUCCEEDED)]

    def _release(self, goal: GoalOrder) -> list[Published]:
        dock_index = next(
            (dock_index for dock_index in sorted(self._docks) if self._docks[dock_index][0] == goal.name),
            None,
        )
        if dock_index is None:
            return self._end(GoalOutcome.ABORTED, f"holds no {goal.name or 'object without a name'}")
        try:
            last = self._let_go(dock_index)
        except ValueError as refused:
            return self._end(GoalOutcome.ABORTED, str(refused))
        if self._fault not in (Fault.RELEASE_SILENT, Fault.RELEASE_CRASHES):
            return [last, *self._end(GoalOutcome.SUCCEEDED)]
        self._goal = None
        if self._fault is Fault.RELEASE_CRASHES:
            self.has_crashed = True
            for held in sorted(self._docks):
                self._let_go(held)
        return []

    def _let_go(self, dock_index: int) -> HeldPositionPublished:
        """Opens a dock and returns its object's last message. A refusal is a ValueError and changes nothing."""
        last = self._held(dock_index, released=True)
        _, serial = self._docks[dock_index]
        facts = self._apad.receive(OpenDock(self._next_serial(), dock_index, serial), self._apad_ms)
        for fact in facts:
            if isinstance(fact, CommandFailed):
                raise ValueError(fact.reason)
        del self._docks[dock_index]
        return last

    def _goal_end(self, facts: list[VehicleFact]) -> list[Published]:
        """Ends the running goal if `facts` say so; it is always the last goal that the aPad inside was given."""
        published: list[Published] = []
        for fact in facts:
            if isinstance(fact, Arrived) and self._goal is not None and self._goal.kind == GO_TO:
                published += self._end(GoalOutcome.SUCCEEDED)
            elif isinstance(fact, CommandFailed):
                published += self._end(GoalOutcome.ABORTED, fact.reason)
        return published

    def _end(self, outcome: GoalOutcome, reason: str = "") -> list[Published]:
        goal, self._goal = self._goal, None
        return [] if goal is None else [GoalEnded(self.now_ms, goal.key, outcome, reason)]

    def _step(self, at_ms: int, published: list[Published]) -> None:
        since_ms = at_ms - self._start_ms
        published += self._goal_end(self._apad.advance(since_ms))
        published += [self._held(dock_index) for dock_index in self._reported_docks]
        if since_ms % SLOW_PERIOD_MS == 0:
            key = None if self._goal is None else self._goal.key
            published.append(
                BatteryAndProgressPublished(at_ms, self.battery_percent, key, self._covered_percent())
            )
        if since_ms % POSE_PERIOD_MS == 0:
            published.append(PosePublished(at_ms, self.pose))

    @property
    def _reported_docks(self) -> list[int]:
        if self._fault is Fault.COUNTS_DOCKS:
            return [dock_index for dock_index in range(len(self._docks)) if dock_index in self._docks]
        return sorted(self._docks)

    def _held(self, dock_index: int, *, released: bool = False) -> HeldPositionPublished:
        return HeldPositionPublished(
            self.now_ms, self._docks[dock_index][0], *self._apad.dock_position(dock_index), released
        )

    def _covered_percent(self) -> float:
        goal, pose = self._goal, self._apad.pose
        if goal is None or goal.kind != GO_TO or self._start_distance_m == 0:
            return 0.0
        left_m = math.hypot(goal.north_m - pose.north_m, goal.east_m - pose.east_m)
        return 100 * (1 - left_m / self._start_distance_m)
