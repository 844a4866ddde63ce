"""The gate: every order that moves a vehicle or an aMussel passes it, and each guard (guards.py) is asked.

A flight wraps its vehicle's link into a `GuardedVehicle` (guarded_vehicle.py), so that the mission, scripts, calls and
persons have no other road to it. An order that was let out at one time leaves at another: the links ask the same `Gate`
again when they put an order into words, and directly before the bytes leave (`lets_go`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace

from apad_bridge.events.event import Event
from apad_bridge.events.guard_events import (
    SURFACING,
    OrderRefused,
    PositionErrorReported,
    SteeringReported,
    WatchdogReported,
)
from apad_bridge.vehicle.commands import (
    PRIMITIVE_NAMES,
    BatteryReported,
    CloseDock,
    DockClosed,
    GoTo,
    Hold,
    MoveArm,
    OpenDock,
    PilotLeft,
    PilotReported,
    PoseReported,
    ReleaseByName,
    Stop,
    VehicleCommand,
)
from apad_bridge.vehicle.guards.battery_watch import BatteryWatch
from apad_bridge.vehicle.guards.frozen_position import NEVER_MS
from apad_bridge.vehicle.guards.guarded_orders import (
    BodyInWater,
    GuardedOrder,
    Point,
    Surfacing,
    VehicleSituation,
    is_stop,
)
from apad_bridge.vehicle.guards.guards import Guard, unlimited_guards
from apad_bridge.vehicle.guards.monitor import DEFAULT_STOPPING, Monitor, Stopping
from apad_bridge.vehicle.guards.position_watch import PositionLimits, PositionWatch
from apad_bridge.vehicle.guards.stops import Latch, Stops
from apad_bridge.vehicle.guards.watchdog_watch import WatchdogWatch
from apad_bridge.vehicle.guards.waters import OpenWaters, Waters
from apad_bridge.vehicle.vehicle_link import Cleared, LinkFact, Sendable

NAMES: dict[type, str] = {
    **PRIMITIVE_NAMES,
    MoveArm: "move an arm",
    ReleaseByName: "undock",
    Stop: "stop",
    PilotLeft: "take the aPad from its pilot",
    Surfacing: SURFACING,
}
PILOT_STEERS = "the pilot has it: a pilot steers the aPad"
PILOT_UNKNOWN = (
    "nobody publishes the pilot's flag any more, so that nobody can tell if a pilot steers the aPad"
)
WAY_BACK_M = 5.0
"""The longest way back inside the fence on a person's word."""


WAY_BACK_M_S = 0.3
RETURN_RADIUS_M = 1.0


@dataclass(frozen=True, slots=True)
class _LetOut(Cleared[Sendable]):
    order: Sendable
    under: int
    asks_guards: bool = True
    """False for a stop, and for a way that was judged as a whole: only the latch holds it up."""


@dataclass(frozen=True, slots=True)
class Refusal:
    guard: str
    reason: str


class Gate:
    """Judges orders by the newest facts of the vehicle. `events` are the journal's lines that nobody has taken yet."""

    def __init__(
        self,
        guards: Sequence[Guard],
        watch: PositionWatch,
        waters: Waters | None = None,
        watchdog: WatchdogWatch | None = None,
    ) -> None:
        self._guards = tuple(guards)
        self._waters = waters or OpenWaters()
        self.watch = watch
        self.battery = BatteryWatch()
        self.watchdog = watchdog or WatchdogWatch()
        self.events: list[Event] = []
        self.latch = Latch()
        self.stops = Stops(self.events, self.latch)
        self._bodies: tuple[BodyInWater, ...] = ()
        """The bodies that must not be touched."""
        self._others = ""
        """The reason why another party has the vehicle, until a person decides; empty while none has."""
        self.pilot = ""
        """The reason why nothing may be ordered for a pilot's sake; empty where none steers."""
        self._obeys_speed = True

    @classmethod
    def without_guards(cls) -> Gate:
        """Lets everything pass, for a vehicle that is tested by itself."""
        return cls([], PositionWatch(PositionLimits()))

    @property
    def awaits_person(self) -> str:
        """The reason why nothing moves until a person allows it; empty while nothing is in the way."""
        stop = self.stops.in_force
        return stop.text() if stop is not None else self._others

    def note_vehicle(self, *, obeys_speed: bool) -> None:
        """Takes what the vehicle can do. One that obeys no speed is not sent back inside the fence from here."""
        self._obeys_speed = obeys_speed

    def note_others(self, reason: str) -> None:
        """Another party has the vehicle, for this reason, until a person decides; the first reason counts."""
        if not self._others:
            self.latch.turn()
        self._others = self._others or reason

    def forget_others(self) -> None:
        """A person has decided that the vehicle is ours."""
        self._others = ""

    def see_bodies(self, bodies: tuple[BodyInWater, ...]) -> None:
        """Takes the bodies that must not be touched, in place of those before."""
        self._bodies = bodies

    def hear_watchdog(self, said: Sequence[str], now_ms: int) -> None:
        """Takes what the vehicle's watchdog said since the last tick; a line when it stops watching or begins again."""
        if self.watchdog.look(said, now_ms):
            fault = self.watchdog.fault
            self.events.append(WatchdogReported(not fault, fault or None))

    def why_not_continue(self, number: int | None, now_ms: int, *, pilot_left: bool = False) -> str:
        """The reason why a person's word to continue after stop `number` changes nothing; or empty.

        None is the newest stop, and 0 says that none is in force.
        """
        stop = self.stops.in_force
        if number == 0 and stop is not None:
            return f"name the stop: {stop.text()}"
        if number and (stop is None or number != stop.number):
            newest = "no stop is in force" if stop is None else stop.text()
            return f"stop {number} is not in force: {newest}"
        if self.pilot and not pilot_left:
            return self.pilot
        if fault := self.watch.fault_now(now_ms):
            return fault
        if outside := self._outside():
            return f"the aPad at {outside}: bring it back first"
        return ""

    def way_back(self, now_ms: int) -> tuple[Point, str]:
        """The place inside the waters to which a person may send a vehicle outside, and the reason why not; or empty."""
        situation = self.situation(now_ms)
        if situation.place_m is None or self.pilot or situation.position_fault:
            return (0.0, 0.0), self.pilot or situation.position_fault
        if not situation.outside:
            return situation.place_m, "the aPad is inside the fence"
        if (stop := self.stops.in_force) is not None and stop.stills_arms:
            return situation.place_m, f"{stop.text()}: bring it back by joystick"
        if not self._obeys_speed:
            return situation.place_m, "this aPad obeys no speed: bring it back by joystick"
        return self._waters.way_back(situation.place_m, WAY_BACK_M)

    def observe(self, facts: Iterable[LinkFact]) -> None:
        """Takes the vehicle's newest position and charge, and who is in a dock; repeated facts change nothing."""
        for fact in facts:
            if isinstance(fact, PoseReported):
                self._take_pose(fact)
            elif isinstance(fact, BatteryReported):
                self.battery.take(fact)
            elif isinstance(fact, PilotReported):
                pilot = PILOT_UNKNOWN if fact.steers is None else PILOT_STEERS if fact.steers else ""
                if pilot != self.pilot:
                    self.events.append(SteeringReported(fact.steers))
                    self.latch.turn()
                self.pilot = pilot
            elif isinstance(fact, DockClosed):
                # The next order may come before the bodies are seen again.
                self._bodies = tuple(it for it in self._bodies if it.agent_id != fact.agent_id)

    def _take_pose(self, pose: PoseReported) -> None:
        was_too_noisy = self.watch.noise.is_too_great
        self.watch.take(pose)
        if self.watch.noise.is_too_great != was_too_noisy:
            error_m = round(self.watch.noise.place_error_m, 2)
            self.events.append(PositionErrorReported(error_m, self.watch.limits.error_m, not was_too_noisy))

    def situation(self, now_ms: int) -> VehicleSituation:
        return VehicleSituation(
            place_m=self.watch.place_m,
            velocity_m_s=self.watch.velocity_m_s,
            least_speed_m_s=self.watch.least_speed_m_s,
            position_fault=self.watch.fault(now_ms),
            outside=self._outside(),
            battery_fraction=self.battery.fraction(now_ms),
            bodies=self._bodies,
            awaits_person=self.awaits_person,
            at_ms=now_ms,
            watchdog_fault=self.watchdog.fault,
        )

    def _outside(self) -> str:
        place_m = self.watch.place_m
        return "" if place_m is None else self._waters.fault_of_place(place_m)

    def refusal(self, order: GuardedOrder, now_ms: int, *, is_persons: bool = False) -> Refusal | None:
        """The first guard's refusal; None for an order that may go out, as every stop may where no pilot steers.

        `is_persons`: the order is itself a person's word, which ends a person's HOLD, and decides about other clients.
        """
        situation = self.situation(now_ms)
        if is_persons and (self.stops.in_force is None or self.stops.is_persons_hold):
            situation = replace(situation, awaits_person="")
        if self.pilot and not isinstance(order, PilotLeft | Surfacing | Stop):
            return Refusal("pilot", self.pilot)
        if self.pilot == PILOT_STEERS and isinstance(order, Stop):
            return Refusal("pilot", self.pilot)
        if is_stop(order, situation):
            return None
        found = ((guard.name, guard.refusal(order, situation)) for guard in self._guards)
        return next((Refusal(name, reason) for name, reason in found if reason), None)

    def clear(self, command: VehicleCommand, now_ms: int) -> Cleared[VehicleCommand] | Refusal:
        return self.refusal(command, now_ms) or _LetOut(command, self.latch.number)

    def clear_for_wire(
        self, sent: Sendable, command: GuardedOrder, before: Cleared[VehicleCommand], now_ms: int
    ) -> Cleared[Sendable] | None:
        """Clears what a link is about to send for the command `before`, maybe once more; `command` is what it does.

        None where a stop, a pilot or another party came since `before` was let out; None, and a line, if a guard refuses.
        """
        asks_guards = not isinstance(before, _LetOut) or before.asks_guards
        if not self.lets_go(before) or (asks_guards and not self.passes(command, now_ms)):
            return None
        return _LetOut(sent, before.under, asks_guards)

    def lets_go(self, cleared: Cleared[Sendable]) -> bool:
        """True for an order that may still leave: no stop, pilot or other party came since. For any thread."""
        return cleared.under == self.latch.number

    def clear_stop(self, stop: Hold | Stop) -> Cleared[VehicleCommand]:
        """A stop of the guards or of a person, whose owner has asked who has the vehicle and whether it may hold."""
        return _LetOut(stop, self.latch.number, asks_guards=False)

    def clear_way_back(self, command_id: int, now_ms: int) -> Cleared[VehicleCommand] | None:
        """The way back inside the fence, which a person has ordered; None where there is no such way."""
        (north_m, east_m), why_not = self.way_back(now_ms)
        if why_not:
            return None
        way = GoTo(command_id, north_m, east_m, WAY_BACK_M_S, RETURN_RADIUS_M)
        return _LetOut(way, self.latch.number, asks_guards=False)

    def clear_return(self, command_id: int, speed_m_s: float) -> Cleared[VehicleCommand] | None:
        """The way of a simulated vehicle to the nearest place inside its waters; None where there is none."""
        place_m = self.watch.place_m
        inside_m = None if place_m is None else self._waters.nearest_inside(place_m)
        if inside_m is None:
            return None
        way = GoTo(command_id, *inside_m, speed_m_s, RETURN_RADIUS_M)
        return _LetOut(way, self.latch.number, asks_guards=False)

    def take_from_pilot(self, command_id: int) -> Cleared[VehicleCommand]:
        """A person says that the pilot has left the vehicle."""
        self.pilot = ""
        return _LetOut(PilotLeft(command_id), self.latch.number)

    def passes(self, order: GuardedOrder, now_ms: int) -> bool:
        """False, and a line in the journal, for an order that a guard refuses."""
        refusal = self.refusal(order, now_ms)
        if refusal is not None:
            self.note_refused(order, refusal)
        return refusal is None

    def note_refused(self, order: GuardedOrder, refusal: Refusal) -> None:
        goal = order if isinstance(order, GoTo | Hold) and refusal.guard != "numbers" else None
        self.events.append(
            OrderRefused(
                NAMES[type(order)],
                refusal.guard,
                refusal.reason,
                agent=order.agent_id
                if isinstance(order, CloseDock | OpenDock | ReleaseByName | Surfacing)
                else None,
                dock=order.dock_index
                if isinstance(order, CloseDock | OpenDock | ReleaseByName | MoveArm)
                else None,
                north_m=None if goal is None else goal.north_m,
                east_m=None if goal is None else goal.east_m,
            )
        )

    def take_events(self) -> list[Event]:
        events = list(self.events)
        self.events.clear()
        return events


@dataclass(frozen=True, slots=True)
class Safety:
    """The parts that keep one vehicle safe, built from its scenario."""

    gate: Gate
    monitor: Monitor
    waters: Waters = field(default_factory=OpenWaters)
    return_speed_m_s: float = 0.5
    """Speed of the way back inside the fence, where the scenario wants one."""
    needs_person: bool = False
    """A real vehicle that had to be stopped moves again when a person allows it, and not before."""
    drift_m_s: Callable[[Point, int], Point] = lambda place_m, now_ms: (0.0, 0.0)
    """The velocity (north, east) with which the known sea takes a vehicle whose controllers are off there."""
    stopping: Stopping = DEFAULT_STOPPING
    """The vehicle's way to rest without thrust."""


def plain_safety() -> Safety:
    """Guards numbers, and that the position is known, and watches nothing: for a simulated aPad without limits of its own.

    Such an aPad flies by a clock that may run hundreds of times faster than the wall's. The age of its position in mission
    time, and how far it seems to jump, then tell how busy the machine is.
    """
    watch = PositionWatch(PositionLimits(age_ms=NEVER_MS, jump_m=math.inf, frozen_ms=NEVER_MS))
    return Safety(Gate(unlimited_guards(), watch), Monitor([]))
