"""The simulated aPad for the event-driven model: the same motion, battery and docks, without a report at each step.

It takes each 100 ms step of `Motion` while the vehicle accelerates, brakes or turns. A cruise at constant speed and
heading is one step of many, and rest is none. It reports at the ticks at which it is asked, and at an arrival.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import assert_never

from apad_bridge.scenario.schema import APad
from apad_bridge.vehicle.capabilities import of_simulated_apad
from apad_bridge.vehicle.commands import (
    Arrived,
    BatteryReported,
    CloseDock,
    CommandFailed,
    DockClosed,
    DockOpened,
    GoTo,
    Hold,
    MoveArm,
    OpenDock,
    PilotLeft,
    PoseReported,
    ReleaseByName,
    Stop,
    VehicleCommand,
)
from apad_bridge.vehicle.vehicle_link import Carried, Cleared, LetGo, LinkFact
from apad_bridge.world.apad.dock_mechanisms import Docks, Misses
from apad_bridge.world.apad.hull_battery import Charger, HullBattery
from apad_bridge.world.apad.kinematics import STEP_MS, STEP_S, Pose
from apad_bridge.world.apad.motion import Motion
from apad_bridge.world.apad.simulated_apad import BATTERY_EMPTY, ArrivalWatch
from firmware_model.power.charge import MS_PER_HOUR

_SECOND_MS = 1000
_STEADY_M_S = 1e-9
"""A cruise is aimed anew at each step, which changes its velocity by rounding alone."""


class CruisingAPad:
    """A `VehicleLink` whose commands come at whole seconds, at the time up to which it was advanced last."""

    def __init__(self, config: APad, misses: Misses, home_m: tuple[float, float] | None = None) -> None:
        self._config = config
        self._motion = Motion(config)
        self.battery = HullBattery(config.battery)
        self._charger = Charger(config, home_m)
        self._docks = Docks(config.docks)
        self._places = of_simulated_apad(config.docks).docks
        self._misses = misses
        self._now_ms = 0
        self._reported_ms = -1
        self._arrival: ArrivalWatch | None = None
        self._running: GoTo | Hold | None = None
        self._has_power = True
        self._facts: list[LinkFact] = []
        most_w = 4 * config.thruster_max_n * config.thruster_w_per_n
        self._most_w = most_w + config.battery.hotel_w + config.docks * config.battery.charging_w_per_dock

    def advance_until(
        self, limit_ms: int, least_fraction: float, passes: Callable[[float, float], None] | None = None
    ) -> int:
        """Lets time pass to the first whole second that somebody must see, at most `limit_ms`; returns it.

        That is the second of an arrival, and any second by which the battery might fall to `least_fraction`. `passes` is
        told the place, north and east in metres, at each whole second before.
        """
        safe_s = math.floor(self._least_h_to(least_fraction) * 3600)
        limit_ms = min(limit_ms, self._now_ms + max(1, safe_s) * _SECOND_MS)
        self._run(limit_ms if passes is None else self._now_ms + _SECOND_MS)
        while passes is not None and self._now_ms < limit_ms and not self._facts:
            passes(self._motion.pose.north_m, self._motion.pose.east_m)
            self._run(self._now_ms + _SECOND_MS)
        return self._now_ms

    def least_charging_ms(self, fraction: float) -> int:
        """The time that its charger takes at least until the battery holds `fraction`; 0 without a charger."""
        home, battery = self._config.home, self._config.battery
        if home is None:
            return 0
        missing_wh = (fraction - self.battery.fraction) * battery.capacity_wh
        return max(0, math.floor(missing_wh / home.charging_w * MS_PER_HOUR))

    def advance(self, now_ms: int) -> list[LinkFact]:
        self._run(now_ms)
        facts, self._facts = self._facts, []
        if self._reported_ms < now_ms:
            self._reported_ms = now_ms
            self.battery.settle(now_ms)
            facts += [
                self._pose_report(now_ms),
                BatteryReported(now_ms, self.battery.voltage_v, self.battery.fraction),
            ]
        return facts

    def command(self, cleared: Cleared[VehicleCommand], now_ms: int) -> None:
        command = cleared.order
        self.battery.settle(now_ms)
        if self.battery.is_empty and not isinstance(command, MoveArm):
            self._facts.append(CommandFailed(now_ms, command.command_id, BATTERY_EMPTY))
            return
        match command:
            case GoTo(_, north_m, east_m, speed_m_s):
                self._running, self._arrival = command, ArrivalWatch(command)
                self._motion.set_goal(north_m, east_m, speed_m_s)
                self._plan()
            case Hold(_, north_m, east_m):
                self._running, self._arrival = command, None
                self._motion.set_goal(north_m, east_m, math.inf)
                self._plan()
            case CloseDock():
                self._close(command, now_ms)
            case OpenDock(_, dock_index, agent_id):
                carried = self._carried(dock_index, agent_id, now_ms)
                opened = self._docks.open(command, now_ms)
                self._facts += (
                    [carried, opened, LetGo(now_ms, agent_id)] if isinstance(opened, DockOpened) else [opened]
                )
                self._set_load()
            case MoveArm() | ReleaseByName():
                pass  # arms cost nothing here, and no dock of its own lies
            case Stop() | PilotLeft():
                raise AssertionError("no guard stops this aPad: model_gap names guards")
            case _:
                assert_never(command)

    def close(self) -> None:
        pass

    def _close(self, command: CloseDock, now_ms: int) -> None:
        closed = self._docks.try_to_close(command, self._misses, now_ms)
        self._facts.append(closed)
        if isinstance(closed, DockClosed):
            self._facts.append(self._carried(command.dock_index, command.agent_id, now_ms))
        self._set_load()

    def _carried(self, dock_index: int, agent_id: int, now_ms: int) -> Carried:
        """Place of the aMussel in the dock; only its release needs a newer place than its docking's."""
        pose = self._motion.pose
        place_m = self._places.place_m(dock_index, pose.north_m, pose.east_m, pose.heading_rad)
        return Carried(now_ms, agent_id, *place_m)

    def _run(self, until_ms: int) -> None:
        """Lets time pass to `until_ms`, or to the end of the second in which the vehicle arrives."""
        motion, now_ms = self._motion, self._now_ms
        span_h = (until_ms - now_ms) / MS_PER_HOUR
        may_run_out = self._has_power and self._least_h_to(0.0) <= span_h
        while now_ms < until_ms and (motion.is_moving or self._arrival is not None or may_run_out):
            before = motion.pose
            now_ms += STEP_MS
            self.battery.settle(now_ms)
            motion.end_step()
            if self._arrival is not None and self._arrival.has_arrived(motion.pose):
                self._facts += [
                    self._pose_report(now_ms),
                    Arrived(now_ms, self._arrival.command.command_id),
                ]
                self._arrival = None
                until_ms = min(until_ms, -(-now_ms // _SECOND_MS) * _SECOND_MS)
            if self.battery.is_empty and self._has_power:
                self._lose_power(now_ms)
            self._plan()
            steps = 0 if may_run_out else min(self._steady_steps(before), (until_ms - now_ms) // STEP_MS)
            if steps > 1:
                now_ms += steps * STEP_MS
                self.battery.settle(now_ms)
                self._cruise(steps)
        self._now_ms = until_ms

    def _least_h_to(self, fraction: float) -> float:
        """Hours until the battery is down to `fraction` under the largest load."""
        left_wh = (self.battery.fraction - fraction) * self._config.battery.capacity_wh
        return max(0.0, left_wh) / self._most_w

    def _lose_power(self, now_ms: int) -> None:
        self._has_power = False
        if self._running is not None and (self._arrival is not None or isinstance(self._running, Hold)):
            failed = CommandFailed(now_ms, self._running.command_id, BATTERY_EMPTY)
            self._facts += [self._pose_report(now_ms), failed]
        self._running = self._arrival = None
        self._motion.cut_power()

    def _steady_steps(self, before: Pose) -> int:
        """The number of steps that change nothing but the place, well before the vehicle brakes or arrives."""
        pose, arrival = self._motion.pose, self._arrival
        if (
            arrival is None
            or pose.heading_rad != before.heading_rad
            or abs(pose.north_m_s - before.north_m_s) > _STEADY_M_S
            or abs(pose.east_m_s - before.east_m_s) > _STEADY_M_S
        ):
            return 0
        speed_m_s, goal = pose.speed_m_s, arrival.command
        if speed_m_s < _STEADY_M_S:
            return 0
        left_m = math.hypot(goal.north_m - pose.north_m, goal.east_m - pose.east_m)
        braking_m = speed_m_s**2 / (2 * self._motion.acceleration_m_s2)
        # The arrival rule takes the mean of a whole second, which is to be stepped before the victory radius.
        keep_m = braking_m + goal.victory_radius_m + 1.5 * speed_m_s
        return math.floor((left_m - keep_m) / (speed_m_s * STEP_S))

    def _cruise(self, steps: int) -> None:
        pose, span_s = self._motion.pose, steps * STEP_S
        self._motion.pose = Pose(
            pose.north_m + span_s * pose.north_m_s,
            pose.east_m + span_s * pose.east_m_s,
            pose.heading_rad,
            pose.north_m_s,
            pose.east_m_s,
        )
        self._plan()

    def _plan(self) -> None:
        self._motion.plan_step()
        self._set_load()

    def _set_load(self) -> None:
        self.battery.set_load(
            self._motion.power_w, len(self._docks.docked), self._charger.power_w(self._motion)
        )

    def _pose_report(self, at_ms: int) -> PoseReported:
        pose = self._motion.pose
        return PoseReported(at_ms, pose.north_m, pose.east_m, pose.heading_rad)
