"""The simulated aPad: three verbs in mission time, with a real aPad's commands and facts."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping
from types import MappingProxyType

from apad_bridge.beliefs.input_ranges import out_of_range
from apad_bridge.scenario.hull_in_flow import Surface
from apad_bridge.scenario.schema import APad
from apad_bridge.vehicle.capabilities import of_simulated_apad
from apad_bridge.vehicle.commands import (
    Arrived,
    BatteryReported,
    CloseDock,
    CommandAccepted,
    CommandFailed,
    GoTo,
    Hold,
    MoveArm,
    OpenDock,
    PilotLeft,
    PoseReported,
    ReleaseByName,
    Stop,
    VehicleCommand,
    VehicleFact,
)
from apad_bridge.world.apad.dock_mechanisms import Docks, Misses
from apad_bridge.world.apad.hull_battery import Charger, HullBattery
from apad_bridge.world.apad.kinematics import STEP_MS, Pose
from apad_bridge.world.apad.motion import Coast, Motion, Steer

ARRIVAL_SAMPLES = 1000 // STEP_MS
REPORT_MS = 1000
BATTERY_EMPTY = "the aPad's battery is empty"


class ArrivalWatch:
    """The public aPad stack's arrival rule: the last second's mean distance is below the victory radius.

    A go-to never arrives within its first second.
    """

    def __init__(self, command: GoTo) -> None:
        self.command = command
        self._distances_m: deque[float] = deque(maxlen=ARRIVAL_SAMPLES)

    def has_arrived(self, pose: Pose) -> bool:
        """Takes the pose at the end of a step as a sample."""
        north_m, east_m = self.command.north_m - pose.north_m, self.command.east_m - pose.east_m
        self._distances_m.append((north_m * north_m + east_m * east_m) ** 0.5)
        full = len(self._distances_m) == ARRIVAL_SAMPLES
        return full and math.fsum(self._distances_m) / ARRIVAL_SAMPLES < self.command.victory_radius_m


MotionCommand = GoTo | Hold | Coast | Steer
"""The commands that move the vehicle; one at a time."""


class SimulatedAPad:
    """Starts at rest at `start_m`, bow north, docks open, holding; time starts at 0.

    It lives on an absolute grid of 100 ms. A command between two grid instants acts from the later one, so
    that the cuts of time never show; docks act at the very millisecond. The aPad reports its battery every
    second, its pose every 100 ms while moving and every second at rest.

    With an empty battery the thrusters and the mechanisms stop: the running go-to or hold fails, closed docks
    stay closed, drag brings the vehicle to rest, every further command fails, and the aPad goes on reporting.

    `misses` decides which dockings fail; without it, no docking fails. `home_m` is where it is charged if the
    configuration has a `home`; None for its start. `held` are the aMussels that it has docked already, by dock index.
    `surface` is the sea's flow, whose time 0 is the aPad's; None for calm water. A steady flow lets an aPad rest that it
    cannot move; one that changes acts within a second.
    """

    def __init__(
        self,
        config: APad,
        misses: Misses | None = None,
        home_m: tuple[float, float] | None = None,
        held: Mapping[int, int] = MappingProxyType({}),
        surface: Surface | None = None,
    ) -> None:
        self._surface = surface
        self.motion = Motion(config)
        self.battery = HullBattery(config.battery)
        self._charger = Charger(config, home_m)
        self.capabilities = of_simulated_apad(config.docks)
        self._docks = Docks(config.docks, held)
        self._misses = misses
        self._now_ms = 0
        self._instant_ms = -STEP_MS
        """The last processed grid instant; at rest the aPad passes over instants without work."""
        self._running: MotionCommand | None = None
        self._accepted: MotionCommand | None = None
        """A command between two grid instants that does not act yet."""
        self._arrival: ArrivalWatch | None = None
        self._has_power = True

    @property
    def next_due_ms(self) -> int:
        if self.motion.is_moving or self._arrival is not None or self._accepted is not None:
            return self._instant_ms + STEP_MS
        return (self._instant_ms // REPORT_MS + 1) * REPORT_MS

    def advance(self, now_ms: int) -> list[VehicleFact]:
        """Let time pass up to and including `now_ms`. Raises ValueError when time went back."""
        if now_ms < self._now_ms:
            raise ValueError(f"time went back from {self._now_ms} to {now_ms} ms")
        facts: list[VehicleFact] = []
        while (due_ms := self.next_due_ms) <= now_ms:
            self._process_instant(due_ms, facts)
        self._now_ms = now_ms
        return facts

    def receive(self, command: VehicleCommand | Coast | Steer, now_ms: int) -> list[VehicleFact]:
        """Take a command, after the work due until `now_ms`. A motion command silently replaces the previous one."""
        facts = self.advance(now_ms)
        self.battery.settle(now_ms)
        if isinstance(command, Coast | Steer | Stop):
            if not self.battery.is_empty:
                self._accept(Coast() if isinstance(command, Stop) else command)
            if isinstance(command, Stop):  # without power the controllers are off already
                facts.append(CommandAccepted(now_ms, command.command_id))
        elif isinstance(command, MoveArm | PilotLeft | ReleaseByName):
            pass  # arms cost nothing here, no pilot steers it, and no dock of its own lies
        elif self.battery.is_empty:
            facts.append(CommandFailed(now_ms, command.command_id, BATTERY_EMPTY))
        elif isinstance(command, CloseDock):
            place_m = self.pose.north_m, self.pose.east_m
            facts.append(self._docks.try_to_close(command, self._misses, now_ms, place_m))
            self._set_load()
        elif isinstance(command, OpenDock):
            facts.append(self._docks.open(command, now_ms))
            self._set_load()
        elif reason := _refusal(command):
            facts.append(CommandFailed(now_ms, command.command_id, reason))
        else:
            self._accept(command)
            facts.append(CommandAccepted(now_ms, command.command_id))
        return facts

    def change_battery(self, fraction: float, now_ms: int) -> list[VehicleFact]:
        """Somebody charges the battery by a fraction of a full one, or with a minus drains it."""
        facts = self.advance(now_ms)
        self.battery.settle(now_ms)
        self.battery.add(fraction)
        return facts

    def _accept(self, command: MotionCommand) -> None:
        self._arrival = None
        self._accepted = command
        self._instant_ms = max(self._instant_ms, self._now_ms // STEP_MS * STEP_MS)
        if self._now_ms == self._instant_ms:
            self._begin_accepted()
            self._plan()

    def _begin_accepted(self) -> None:
        command, self._accepted = self._accepted, None
        if command is None:
            return
        self._running = command
        match command:
            case GoTo(_, north_m, east_m, speed_m_s):
                self.motion.set_goal(north_m, east_m, speed_m_s)
                self._arrival = ArrivalWatch(command)
            case Hold(_, north_m, east_m):
                self.motion.set_goal(north_m, east_m, math.inf)
                if command.heading_rad is not None:
                    self.motion.turn_to(command.heading_rad)
            case Steer():
                self.motion.steer(command)
            case Coast():
                self.motion.cut_power()

    def _process_instant(self, at_ms: int, facts: list[VehicleFact]) -> None:
        """One grid instant: end the step before it, report facts, plan the step after it."""
        self.battery.settle(at_ms)
        was_moving = self.motion.is_moving
        self.motion.end_step()
        self._instant_ms = at_ms
        pose = self.motion.pose
        if was_moving or at_ms % REPORT_MS == 0:
            facts.append(PoseReported(at_ms, pose.north_m, pose.east_m, pose.heading_rad, at_ms))
        if at_ms % REPORT_MS == 0:
            facts.append(BatteryReported(at_ms, self.battery.voltage_v, self.battery.fraction))
        if self._arrival is not None and self._arrival.has_arrived(pose):
            facts.append(Arrived(at_ms, self._arrival.command.command_id))
            self._arrival = None
        self._begin_accepted()
        if self.battery.is_empty and self._has_power:
            self._lose_power(at_ms, facts)
        self._plan()

    def _lose_power(self, at_ms: int, facts: list[VehicleFact]) -> None:
        self._has_power = False
        if self._arrival is not None or isinstance(self._running, Hold):
            assert isinstance(self._running, GoTo | Hold)
            facts.append(CommandFailed(at_ms, self._running.command_id, BATTERY_EMPTY))
        self._running = self._arrival = None
        self.motion.cut_power()

    def _plan(self) -> None:
        if self._surface is not None:
            pose = self.pose
            self.motion.take_flow(self._surface.flow((pose.north_m, pose.east_m), self._instant_ms))
        self.motion.plan_step()
        self._set_load()

    def _set_load(self) -> None:
        self.battery.set_load(
            self.motion.power_w, len(self._docks.docked), self._charger.power_w(self.motion)
        )

    @property
    def pose(self) -> Pose:
        """The pose at the last grid instant."""
        return self.motion.pose

    @property
    def docked(self) -> Mapping[int, int]:
        """Agent ids by dock index, of the closed docks."""
        return self._docks.docked

    def dock_position(self, dock_index: int) -> tuple[float, float]:
        """The place at which dock `dock_index` holds an aMussel: (north, east) in metres."""
        pose = self.pose
        return self.capabilities.docks.place_m(dock_index, pose.north_m, pose.east_m, pose.heading_rad)


def _refusal(command: GoTo | Hold) -> str | None:
    """The reason to refuse a go-to or hold (the field stack aborts at speed 0 and at radius 0 likewise)."""
    if (reason := out_of_range(north_m=command.north_m, east_m=command.east_m)) is not None:
        return f"the goal's {reason}"
    if isinstance(command, GoTo):
        if not command.speed_m_s > 0:
            return "speed_m_s must be above 0"
        if not command.victory_radius_m > 0:
            return "victory_radius_m must be above 0"
    return None
