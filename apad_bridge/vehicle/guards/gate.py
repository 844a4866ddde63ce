"""The gate: every order that moves a vehicle or an aMussel passes it, whoever gives the order.

A flight wraps its vehicle's link into a `GuardedVehicle`, so that the mission, scripts, calls and persons have no other
road to it. The links to vehicles on ROS also repeat orders by themselves; they ask the same `Gate` before each.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from apad_bridge.vehicle.commands import (
    Arrived,
    BatteryReported,
    CloseDock,
    CommandAccepted,
    CommandedByOthers,
    CommandFailed,
    DockClosed,
    GoTo,
    Hold,
    MoveArm,
    OpenDock,
    PoseReported,
    Stop,
    VehicleCommand,
)
from apad_bridge.vehicle.guards.guards import GoodPosition, Guard, SoundNumbers
from apad_bridge.vehicle.guards.monitor import Cause, Finding, Monitor, Reaction, UnderWay
from apad_bridge.vehicle.guards.orders import (
    Body,
    GuardedOrder,
    Situation,
    Surfacing,
    goal_of,
    is_meant_as_stop,
    is_stop,
)
from apad_bridge.vehicle.guards.position_watch import NEVER_MS, PositionLimits, PositionWatch
from apad_bridge.vehicle.guards.waters import OpenWaters, Waters
from apad_bridge.vehicle.link import LinkFact, VehicleLink

NAMES: dict[type, str] = {
    GoTo: "go to point",
    Hold: "hold position",
    CloseDock: "dock",
    OpenDock: "undock",
    MoveArm: "move an arm",
    Stop: "stop",
    Surfacing: "permit to surface",
}
Event = tuple[str, dict[str, Any]]
"""(kind, data) of a line in the journal."""


_Answer = CommandAccepted | Arrived | CommandFailed
RETURN_RADIUS_M = 1.0
GOES_BACK = "the aPad goes back inside the fence, and then waits for a person"
STEERED_BY_OTHERS = "a pilot or another party has steered the aPad: take it over, or give it back"


@dataclass(frozen=True, slots=True)
class Refusal:
    guard: str
    reason: str


class Gate:
    """Judges orders by the newest facts of the vehicle. `events` are the journal's lines that nobody has taken yet."""

    def __init__(self, guards: Sequence[Guard], watch: PositionWatch) -> None:
        self._guards = tuple(guards)
        self.watch = watch
        self.bodies: tuple[Body, ...] = ()
        """The bodies that must not be touched; whoever knows them, sets it."""
        self.awaits_person = ""
        """The reason why nothing moves until a person allows it; empty while nothing is in the way."""
        self.events: list[Event] = []
        self._battery_fraction: float | None = None

    @classmethod
    def without_guards(cls) -> Gate:
        """Lets everything pass, for a vehicle that is tested by itself."""
        return cls([], PositionWatch(PositionLimits()))

    def observe(self, facts: Iterable[LinkFact]) -> None:
        """Takes the vehicle's newest position and charge, and who is in a dock; repeated facts change nothing."""
        for fact in facts:
            if isinstance(fact, PoseReported):
                self.watch.take(fact)
            elif isinstance(fact, BatteryReported):
                self._battery_fraction = fact.fraction
            elif isinstance(fact, DockClosed):
                # The next order may come before whoever knows the bodies sets them again.
                self.bodies = tuple(it for it in self.bodies if it.agent_id != fact.agent_id)

    def situation(self, now_ms: int) -> Situation:
        return Situation(
            self.watch.place_m,
            self.watch.velocity_m_s,
            self.watch.least_speed_m_s,
            self.watch.fault(now_ms),
            self._battery_fraction,
            self.bodies,
            self.awaits_person,
        )

    def refusal(self, order: GuardedOrder, now_ms: int) -> Refusal | None:
        """The first guard's refusal; None for an order that may go out, as every stop may."""
        situation = self.situation(now_ms)
        if is_stop(order, situation):
            return None
        found = ((guard.name, guard.refusal(order, situation)) for guard in self._guards)
        return next((Refusal(name, reason) for name, reason in found if reason), None)

    def passes(self, order: GuardedOrder, now_ms: int) -> bool:
        """False, and a line in the journal, for an order that a guard refuses."""
        refusal = self.refusal(order, now_ms)
        if refusal is not None:
            self.note_refused(order, refusal)
        return refusal is None

    def note_refused(self, order: GuardedOrder, refusal: Refusal) -> None:
        data: dict[str, Any] = {"order": NAMES[type(order)], "guard": refusal.guard, "reason": refusal.reason}
        for key, name in (("agent", "agent_id"), ("dock", "dock_index")):
            if (value := getattr(order, name, None)) is not None:
                data[key] = value
        if isinstance(order, GoTo | Hold) and refusal.guard != "numbers":
            data |= {"north_m": order.north_m, "east_m": order.east_m}
        self.events.append(("refused", data))

    def take_events(self) -> list[Event]:
        events, self.events = self.events, []
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


def plain_safety() -> Safety:
    """Guards numbers, and that the position is known, and watches nothing: for a simulated aPad without limits of its own.

    Such an aPad flies by a clock that may run hundreds of times faster than the wall's. The age of its position in mission
    time, and how far it seems to jump, then tell how busy the machine is.
    """
    watch = PositionWatch(PositionLimits(age_ms=NEVER_MS, jump_m=math.inf, frozen_ms=NEVER_MS))
    return Safety(Gate([SoundNumbers(), GoodPosition()], watch), Monitor([]))


class GuardedVehicle:
    """A VehicleLink behind the gate, and behind a monitor that reacts between orders.

    A refused command fails at once, with the guard's reason. If the vehicle is under way then, it holds where it is,
    because what it was doing has made way for that command. A refused hold near the vehicle is a stop: it holds right
    where it is instead, or its controllers go off if the position is bad. A pilot is called where no order does that
    (`can_stop`).
    """

    def __init__(self, link: VehicleLink, safety: Safety, *, can_stop: bool) -> None:
        self._link = link
        self._safety = safety
        self.gate = safety.gate
        self._can_stop = can_stop
        self._facts: list[LinkFact] = []
        self._under_way: UnderWay | None = None
        self._ordered: GoTo | Hold | None = None
        """The newest order where to go or stay. Until the vehicle has accepted it, it follows the one before."""
        self._own_id = 0
        """Commands of the guards' own have ids below 0, which no port uses."""
        self._looked_ms = -1
        self._way_back: GoTo | None = None
        """The way back inside the fence, while a real vehicle is on it; a person's word is awaited at its end."""
        self._own_hold_id: int | None = None
        """The guards' own hold that went out last, until it is taken or another command goes out."""

    def advance(self, now_ms: int) -> list[LinkFact]:
        """The link's facts, and the failures of refused commands. Once a tick the monitor looks, and reacts."""
        facts = [*self._facts, *self._link.advance(now_ms)]
        self._facts = []
        self.gate.observe(facts)
        for fact in facts:
            if isinstance(fact, CommandAccepted):
                self._note_acceptance(fact)
            elif isinstance(fact, Arrived | CommandFailed):
                self._note_end(fact.command_id)
                if fact.command_id == self._own_hold_id:
                    self._note_own_hold(fact, now_ms)
            elif isinstance(fact, CommandedByOthers) and self._safety.needs_person:
                self.gate.awaits_person = STEERED_BY_OTHERS
        if now_ms > self._looked_ms:
            self._looked_ms = now_ms
            self._look(now_ms)
        facts += self._facts
        self._facts = []
        return [it for it in facts if not (isinstance(it, _Answer) and it.command_id < 0)]

    def command(self, command: VehicleCommand, now_ms: int) -> None:
        refusal = self.gate.refusal(command, now_ms)
        if self._way_back is not None and not is_stop(command, self.gate.situation(now_ms)):
            # The vehicle goes on: a hold here would leave it outside.
            self._note_refusal(command, Refusal("person", GOES_BACK), now_ms)
        elif refusal is None:
            self._send(command, now_ms)
        elif isinstance(command, Hold) and is_meant_as_stop(command, self.gate.situation(now_ms)):
            self._stop_here(command, now_ms)
        else:
            self._refuse(command, refusal, now_ms)

    def allow_motion(self) -> None:
        """A person lets the vehicle move again, whatever stopped it."""
        self.gate.awaits_person = ""
        self._way_back = None

    def switch_off(self, reason: str, now_ms: int) -> None:
        """A person wants the controllers off; where no order does that, a pilot is called."""
        self._react(Finding(Cause.PERSON, Reaction.STOP, reason), now_ms)

    def close(self) -> None:
        self._link.close()

    def _note_refusal(self, command: VehicleCommand, refusal: Refusal, now_ms: int) -> None:
        self.gate.note_refused(command, refusal)
        if not isinstance(command, MoveArm):  # nobody awaits an answer to it
            self._facts.append(CommandFailed(now_ms, command.command_id, f"refused: {refusal.reason}"))

    def _refuse(self, command: VehicleCommand, refusal: Refusal, now_ms: int) -> None:
        self._note_refusal(command, refusal, now_ms)
        if self._under_way is not None:
            self._stop_here(Hold(self._take_id(), 0.0, 0.0), now_ms)

    def _stop_here(self, command: Hold, now_ms: int) -> None:
        """Ends the vehicle's motion in the one way that its position allows; `command` gives the id."""
        situation = self.gate.situation(now_ms)
        if situation.place_m is not None and not situation.position_fault:
            self._send(replace(command, north_m=situation.place_m[0], east_m=situation.place_m[1]), now_ms)
        else:
            self._switch_off(command.command_id, now_ms)

    def _switch_off(self, command_id: int, now_ms: int) -> None:
        self._under_way = self._ordered = None
        self.gate.watch.note_goal(None)
        if self._can_stop:
            self._send(Stop(command_id), now_ms)

    def _send(self, command: VehicleCommand, now_ms: int) -> None:
        if not isinstance(command, MoveArm):
            is_own_hold = isinstance(command, Hold) and command.command_id < 0
            self._own_hold_id = command.command_id if is_own_hold else None
            self._end_way_back(command.command_id)
            self._under_way = UnderWay(command) if isinstance(command, GoTo) else None
            self._ordered = command if isinstance(command, GoTo | Hold) else None
            if self._ordered is None:
                self.gate.watch.note_goal(None)
        self._link.command(command, now_ms)

    def _note_acceptance(self, fact: CommandAccepted) -> None:
        if self._ordered is None or fact.command_id != self._ordered.command_id:
            return  # of an order that another one has replaced
        self.gate.watch.note_goal(goal_of(self._ordered), fact.at_ms)
        if isinstance(self._ordered, GoTo):
            self._under_way = UnderWay(self._ordered, fact.at_ms)

    def _note_end(self, command_id: int) -> None:
        if self._under_way is not None and command_id == self._under_way.command.command_id:
            self._under_way = self._ordered = None
            self.gate.watch.note_goal(None)
            self._end_way_back(None)

    def _end_way_back(self, command_id: int | None) -> None:
        """The way back has ended, by itself or for the command with this id: nothing moves until a person allows it."""
        if self._way_back is not None and self._way_back.command_id != command_id:
            self._way_back = None
            self.gate.awaits_person = (
                "a person must confirm that the aPad may continue: it had left the fence, and was sent back"
            )

    def _note_own_hold(self, fact: Arrived | CommandFailed, now_ms: int) -> None:
        """A stop that was lost on the way, as where a link comes back by and by, is given again until it is taken."""
        self._own_hold_id = None
        if isinstance(fact, CommandFailed) and self.gate.awaits_person not in ("", STEERED_BY_OTHERS):
            self._stop_here(Hold(self._take_id(), 0.0, 0.0), now_ms)

    def _take_id(self) -> int:
        self._own_id -= 1
        return self._own_id

    # The monitor.

    def _look(self, now_ms: int) -> None:
        for change in self._safety.monitor.look(self.gate.situation(now_ms), self._under_way, now_ms):
            if change.finding is not None:
                self._react(change.finding, now_ms)
                continue
            self.gate.events.append(("guard_over", {"cause": change.cause.value}))
            if change.cause is Cause.POSITION and self.gate.awaits_person != STEERED_BY_OTHERS:
                self._stop_here(Hold(self._take_id(), 0.0, 0.0), now_ms)

    def _react(self, finding: Finding, now_ms: int) -> None:
        """Fails the command under way, and brings the vehicle to rest or back."""
        self._way_back = None
        calls_pilot = finding.cause is Cause.OUTSIDE or (
            finding.reaction is Reaction.STOP and not self._can_stop
        )
        self.gate.events.append(
            (
                "guard",
                {
                    "cause": finding.cause.value,
                    "reaction": finding.reaction.value,
                    "reason": finding.reason,
                    "calls_pilot": calls_pilot,
                },
            )
        )
        if self._under_way is not None:
            self._facts.append(CommandFailed(now_ms, self._under_way.command.command_id, finding.reason))
        if self.gate.awaits_person == STEERED_BY_OTHERS:
            return  # they have it, and a person is told; an order would take it out of their hands
        if finding.reaction is Reaction.STOP:
            self._switch_off(self._take_id(), now_ms)
        elif finding.reaction is Reaction.RETURN and (back := self._goal_inside()) is not None:
            self._way_back = back if self._safety.needs_person else None
            self._send(back, now_ms)
            return
        else:
            self._stop_here(Hold(self._take_id(), 0.0, 0.0), now_ms)
        if self._safety.needs_person:
            self.gate.awaits_person = (
                f"a person must confirm that the aPad may continue after this: {finding.reason}"
            )

    def _goal_inside(self) -> GoTo | None:
        place_m = self.gate.watch.place_m
        inside_m = None if place_m is None else self._safety.waters.nearest_inside(place_m)
        if inside_m is None:
            return None
        return GoTo(self._take_id(), *inside_m, self._safety.return_speed_m_s, RETURN_RADIUS_M)
