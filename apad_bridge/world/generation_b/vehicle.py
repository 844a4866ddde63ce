"""The simulated aPad with generation B's behaviour, without ROS: orders and detections in, messages out.

It copies the published stack, surprises included. The stack takes an order at once and reports its end on
topics. Nothing has a time-out. The end of any primitive leaves the controllers off, and the water takes the
boat. Dynamic positioning holds until the next order. Docking and undocking first stand still for 27 s;
docking then searches, for ever if need be, and approaches the detected aMussel (`servoing`). It holds no
aMussel by itself: the stack never reports whether it caught one.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from enum import Enum, auto

from apad_bridge.scenario.faults import Fault
from apad_bridge.vehicle.commands import Arrived, CloseDock, CommandFailed, GoTo, Hold, OpenDock, Stop
from apad_bridge.vehicle.generation_b.messages import (
    CAMERA_SERVO,
    DETECTION_MS,
    PULL_BACK_M_S,
    PULL_BACK_MS,
    SERVO_MS,
    DockingOrder,
    PrimitiveStatus,
    ServiceOrder,
    arms,
    dock_direction_rad,
)
from apad_bridge.world.apad.kinematics import STEP_MS
from apad_bridge.world.apad.motion import Coast, Steer
from apad_bridge.world.apad.simulated_apad import SimulatedAPad
from apad_bridge.world.generation_b.simulated_messages import (
    ArmPublished,
    BatteryPublished,
    CameraTurned,
    Finished,
    GoToBegun,
    GoToEnded,
    GoToLeft,
    Published,
    StatusPublished,
)
from apad_bridge.world.simulated_stack import PosePublished, SimulatedStack

CLOSE_ENOUGH = (0.8, 0.9)
SLOW_PERIOD_MS = 1000
"""Period of battery and statuses; a changed status goes out at once, too."""
_WANDERS_MS = 5_000


@dataclass(frozen=True, slots=True)
class Detection:
    """The camera's detection of an aMussel: in image coordinates, 0 the middle and 1 an edge."""

    at_ms: int
    horizontal: float
    vertical: float


def servoing(order: DockingOrder, seen: Detection | None, now_ms: int) -> Steer | None:
    """Generation B's law of visual servoing, read from its source: the steering at `now_ms`; None when docked.

    Without a detection younger than a second the boat searches, by turning. With a detection, yaw rate =
    max * tanh(horizontal) and surge = max * exp(-horizontal^2 / (2 * stdev^2)) towards the dock, until
    `docking_vertical` lies in (0.8, 0.9), which is the end.
    """
    towards_rad = dock_direction_rad(order.dock_index)
    if seen is None or now_ms - seen.at_ms > DETECTION_MS:
        return Steer(0.0, towards_rad, order.search_yaw_rate_rad_s)
    if CLOSE_ENOUGH[0] < seen.vertical < CLOSE_ENOUGH[1]:
        return None
    stdev = max(order.surge_stdev, 1e-6)
    surge_m_s = order.max_surge_m_s * math.exp(-(seen.horizontal**2) / (2 * stdev**2))
    return Steer(surge_m_s, towards_rad, order.max_yaw_rate_rad_s * math.tanh(seen.horizontal))


_AT_ONCE = {Fault.DROPS: PrimitiveStatus.PREEMPTED, Fault.LIES: PrimitiveStatus.DONE}
"""The status with which a go-to ends as soon as it begins."""


class Stage(Enum):
    OFF = auto()
    """No primitive: controllers off."""
    GOING = auto()
    POSITIONING = auto()
    SERVO = auto()
    """Docking or undocking, standing still in its own callback."""
    SERVOING = auto()
    """Docking: searching, or approaching the detected aMussel."""
    PULLING = auto()


class GenerationBVehicle(SimulatedStack[Published]):
    """The simulated stack of generation B. It has the three verbs in mission time, from `start_ms` on."""

    def __init__(self, apad: SimulatedAPad, start_ms: int = 0, fault: Fault = Fault.NONE) -> None:
        super().__init__(apad, start_ms, STEP_MS, fault)
        self.stage = Stage.OFF
        self._stage_ms = start_ms
        self._order: ServiceOrder | None = None
        self._paused: ServiceOrder | None = None
        self._statuses = {False: PrimitiveStatus.IDLE, True: PrimitiveStatus.IDLE}
        """The status of go-tos under False, of dockings under True."""
        self._horizontal = 0.0
        self._seen: Detection | None = None
        self._is_manual = False

    @property
    def takes(self) -> bool | None:
        """The services' answer to an order; None when they never answer."""
        return {Fault.REFUSES: False, Fault.HANGS: None}.get(self._fault, True)

    @property
    def blocks(self) -> bool:
        """True while calls of its services wait: `commander` in one thread with the docking, as the fault has it."""
        return self._fault is Fault.BLOCKS and self.stage is Stage.SERVO

    def receive(self, order: ServiceOrder, now_ms: int) -> list[Published]:
        """Takes an order, whatever is under way. The stack takes an impossible order too, and aborts it."""
        if not self.takes:
            return self.advance(now_ms)
        published = self.advance(now_ms)
        self._end(PrimitiveStatus.PREEMPTED, published, finished=self.stage is not Stage.OFF)
        self._order = order
        match order:
            case GoTo(_, _, _, speed_m_s, victory_radius_m):
                self._enter(Stage.GOING)
                self._publish(GoToBegun(self.now_ms, order), published)
                self._publish_status(False, PrimitiveStatus.RUNNING, published)
                if self._fault in _AT_ONCE:
                    self._end(_AT_ONCE[self._fault], published, finished=True)
                elif not (speed_m_s > 0 and victory_radius_m > 0):
                    self.dropped["go2point: speed or victory radius is not above 0"] += 1
                    self._end(PrimitiveStatus.IDLE, published, finished=True)
                elif self._fault is not Fault.STUCK:
                    self._command(replace(order, command_id=self._next_serial()), published)
            case Hold():
                self._enter(Stage.POSITIONING)
                self._command(replace(order, command_id=self._next_serial()), published)
            case DockingOrder():
                self._begin_docking(order, published)
            case Stop():
                self._order = None  # what it ends has ended above
        return published

    def stop(self, now_ms: int) -> list[Published]:
        """`stop_mission`: the primitive ends, and with it the controllers."""
        published = self.advance(now_ms)
        self._end(PrimitiveStatus.PREEMPTED, published, finished=self.stage is not Stage.OFF)
        return published

    def pause(self, now_ms: int) -> list[Published]:
        """`pause_mission`: a stop after which `go_on` begins the same primitive again."""
        self._paused = self._order
        return self.stop(now_ms)

    def go_on(self, now_ms: int) -> list[Published]:
        """`continue_mission`: begins the paused primitive again; without one nothing happens."""
        order, self._paused = self._paused, None
        return self.advance(now_ms) if order is None else self.receive(order, now_ms)

    def detect(self, horizontal: float | None, vertical: float | None, now_ms: int) -> list[Published]:
        """Takes a camera message. Each coordinate has its own topic; `vertical`, the second, ends a detection."""
        published = self.advance(now_ms)
        if horizontal is not None:
            self._horizontal = horizontal
        if vertical is not None:
            self._seen = Detection(now_ms, self._horizontal, vertical)
        return published

    def load(self, dock_index: int, closed: bool, now_ms: int) -> list[Published]:
        """The bench, not the stack, sets a dock's occupancy, because charging costs energy."""
        published = self.advance(now_ms)
        serial = self._next_serial()
        holder = self._apad.docked.get(dock_index)
        if closed:
            self._apad.receive(CloseDock(serial, dock_index, serial), now_ms - self._start_ms)
        elif holder is not None:
            self._apad.receive(OpenDock(serial, dock_index, holder), now_ms - self._start_ms)
        return published

    def set_manual(self, steers: bool, now_ms: int) -> list[Published]:
        """A pilot takes or leaves the joystick. It pre-empts primitives, and none begins while it is in use."""
        published = self.advance(now_ms)
        if steers and not self._is_manual:
            self._end(PrimitiveStatus.PREEMPTED, published, finished=self.stage is not Stage.OFF)
        self._is_manual = steers
        return published

    def _begin_docking(self, order: DockingOrder, published: list[Published]) -> None:
        if order.dock_index not in self.dock_indices:
            self.dropped["docking: no such dock"] += 1
            self._order = None
            return
        self._enter(Stage.SERVO)
        self._seen = None
        self._publish_status(True, PrimitiveStatus.RUNNING, published)
        published.append(CameraTurned(self.now_ms, CAMERA_SERVO[order.dock_index]))
        if order.docks:
            self._open_arm(order.dock_index, published)
        self._command(Coast(), published)

    def _open_arm(self, dock_index: int, published: list[Published]) -> None:
        published.append(ArmPublished(self.now_ms, arms(dock_index)))

    def _step(self, at_ms: int, published: list[Published]) -> None:
        """One grid instant: the boat's events, the primitive's reaction, and the periodic messages."""
        for fact in self._apad.advance(at_ms - self._start_ms):
            if isinstance(fact, Arrived) and self.stage is Stage.GOING:
                self._end(PrimitiveStatus.DONE, published, finished=True)
            elif isinstance(fact, CommandFailed):
                self._end(PrimitiveStatus.IDLE, published, finished=True)
        wanders = self._fault is Fault.WANDERS and self.stage is Stage.POSITIONING
        if wanders and at_ms - self._stage_ms >= _WANDERS_MS:
            self._end(PrimitiveStatus.IDLE, published, finished=True)
        if isinstance(self._order, DockingOrder):
            self._servo(self._order, at_ms, published)
        elif isinstance(self._order, GoTo):
            self._publish(self._left(self._order), published)
        published.append(PosePublished(at_ms, self.pose))
        if (at_ms - self._start_ms) % SLOW_PERIOD_MS == 0:
            published.append(BatteryPublished(at_ms, self.battery_percent))
            for docking in (False, True):
                self._publish_status(docking, self._statuses[docking], published)

    def _servo(self, order: DockingOrder, at_ms: int, published: list[Published]) -> None:
        since_ms = at_ms - self._stage_ms
        if self.stage is Stage.SERVO and since_ms >= SERVO_MS:
            if order.docks:
                self._enter(Stage.SERVOING)
            else:
                self._enter(Stage.PULLING)
                self._open_arm(order.dock_index, published)
                astern_rad = dock_direction_rad(order.dock_index) + math.pi
                self._command(Steer(PULL_BACK_M_S, astern_rad, 0.0), published)
        elif self.stage is Stage.PULLING and since_ms >= PULL_BACK_MS:
            self._end(PrimitiveStatus.DONE, published, finished=True)
        if self.stage is Stage.SERVOING:
            if (steered := servoing(order, self._seen, at_ms)) is None:
                self._end(PrimitiveStatus.DONE, published, finished=True)
            else:
                self._command(steered, published)

    def _end(self, status: PrimitiveStatus, published: list[Published], *, finished: bool) -> None:
        """Ends the primitive under way: publishes its status and event, closes the arm, turns the controllers off."""
        stage, order, self._order = self.stage, self._order, None
        self._enter(Stage.OFF)
        if stage is Stage.GOING:
            if isinstance(order, GoTo):
                self._publish(GoToEnded(status, self.pose, self._left(order)), published)
            self._publish_status(False, status, published)
        elif stage in (Stage.SERVO, Stage.SERVOING, Stage.PULLING):
            published.append(ArmPublished(self.now_ms, arms(None)))
            self._publish_status(True, status, published)
        if finished:
            self._publish(Finished(self.now_ms), published)
            self._apad.receive(Coast(), self._apad_ms)

    def _command(self, command: GoTo | Hold | Coast | Steer, published: list[Published]) -> None:
        if self._is_manual and not isinstance(command, Coast):
            self.dropped["order: a pilot steers"] += 1
            self._end(PrimitiveStatus.PREEMPTED, published, finished=True)
            return
        for fact in self._apad.receive(command, self._apad_ms):
            if isinstance(fact, CommandFailed):
                self._end(PrimitiveStatus.IDLE, published, finished=True)

    def _enter(self, stage: Stage) -> None:
        self.stage, self._stage_ms = stage, self.now_ms

    def _publish_status(self, docking: bool, status: PrimitiveStatus, published: list[Published]) -> None:
        self._statuses[docking] = status
        self._publish(StatusPublished(self.now_ms, docking, status), published)

    def _publish(self, message: Published, published: list[Published]) -> None:
        """Publishes a primitive's state, unless the fault silences it."""
        if self._fault is not Fault.SILENT:
            published.append(message)

    def _left(self, order: GoTo) -> GoToLeft:
        north_m, east_m = order.north_m - self.pose.north_m, order.east_m - self.pose.east_m
        return GoToLeft(self.now_ms, math.hypot(north_m, east_m), math.atan2(east_m, north_m))
