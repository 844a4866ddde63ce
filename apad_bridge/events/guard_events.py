"""Events of the guards that stand before the aPad: refusals, dangers, stops, and others who command it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import StrEnum
from typing import Annotated

from apad_bridge.events.event import Category, East, Event, Meaning, North, Reason, Uncounted

SURFACING = "permit to surface"
"""The name of the one guarded order that no primitive stands behind."""


DOES_NOT_OBEY = "the aPad does not obey: cut its power by hand"


class StopKind(StrEnum):
    HOLD = "hold"
    OFF = "off"


class StopState(StrEnum):
    ORDERED = "ordered"
    SENT = "sent"
    TAKEN = "taken"
    OBEYED = "obeyed"
    """The hull slows."""
    NOT_OBEYED = "not obeyed"
    AT_REST = "at rest"
    NOT_TAKEN = "not taken"
    REFUSED = "refused"


class Reaction(StrEnum):
    HOLD = "hold"
    """Hold the present position, which is good."""
    STOP = "stop"
    """Switch the controllers off: the position is not fit to hold."""
    RETURN = "return"
    """Go to the nearest place inside the fence."""


class Cause(StrEnum):
    OUTSIDE = "outside the fence"
    AHEAD = "fence ahead"
    POSITION = "position"
    SPEED = "speed"
    LATE = "late"
    NO_PROGRESS = "no progress"
    ANOTHER_APAD = "another aPad"
    OTHERS = "another client"
    WATCHDOG = "watchdog"


@dataclass(frozen=True)
class OrderRefused(Event):
    kind = "refused"
    when = "a guard refused an order, which did not go out"
    counted = ("order", "guard", "agent", "dock", "north_m", "east_m")

    order: Annotated[
        str,
        Meaning("`go to point`, `hold position`, `dock`, `undock`, `move an arm` or `permit to surface`"),
    ]
    guard: Annotated[str, Meaning("the guard, by name")]
    reason: Reason
    agent: Annotated[int | None, Meaning("the aMussel")] = None
    dock: Annotated[int | None, Meaning("the dock, counted from 0")] = None
    north_m: Annotated[float | None, Meaning("the goal, north", "m")] = None
    east_m: Annotated[float | None, Meaning("the goal, east", "m")] = None

    @property
    def category(self) -> Category:
        """Any other order that is refused fails as a primitive, too."""
        return Category.ALARM if self.order == SURFACING else Category.TROUBLE

    def text(self) -> str:
        if self.order == SURFACING and self.agent is not None:
            return f"aMussel {self.agent} is not permitted to surface: {self.reason}"
        return f"refused to {self.order}, by the guard {self.guard}: {self.reason}"


@dataclass(frozen=True)
class GuardReacted(Event):
    kind = "guard"
    when = "the monitor found the aPad in danger between two orders, and reacted"
    counted = ("cause", "reaction", "calls_pilot")
    category = Category.ALARM

    cause: Annotated[
        Cause,
        Meaning(
            "`outside the fence`, `fence ahead`, `position`, `speed`, `late`, `no progress`, `another aPad`, "
            "`another client` or `watchdog`"
        ),
    ]
    reaction: Annotated[
        Reaction, Meaning("`hold`, `stop` (its controllers go off) or `return` (to a place inside)")
    ]
    reason: Reason
    calls_pilot: Annotated[bool, Meaning("true when a person must take the aPad over")]

    def text(self) -> str:
        reactions = {
            Reaction.HOLD: "the aPad holds where it is",
            Reaction.STOP: "the aPad's controllers go off",
            Reaction.RETURN: "the aPad goes back inside the fence",
        }
        return f"{'PILOT, TAKE IT: ' if self.calls_pilot else ''}{reactions[self.reaction]}: {self.reason}"


@dataclass(frozen=True)
class DangerOver(Event):
    kind = "guard_over"
    when = "that danger is over"
    counted = ("cause",)
    is_shown_at_once = True
    category = Category.RELIEF

    cause: Annotated[Cause, Meaning("as above")]

    def text(self) -> str:
        return f"no longer in danger ({self.cause})"


@dataclass(frozen=True)
class StopChanged(Event):
    kind = "stop"
    when = "a stop of the aPad, by a person or a guard, came to a state; it is in force until `continued`"
    counted = ("number", "mode", "state")
    is_shown_at_once = True

    number: Annotated[int, Meaning("the stop's number in this run")]
    mode: Annotated[StopKind, Meaning("`hold`: the thrusters keep the place; `off`: no thrust")]
    by: Annotated[str, Meaning("the person, or `guard: CAUSE`")]
    state: Annotated[
        StopState,
        Meaning("`taken`: the vehicle has accepted it; `obeyed`: the hull slows; `not obeyed`: it goes on"),
    ]
    reason: Annotated[str | None, Meaning("why")] = None
    is_persons: Annotated[bool | None, Meaning("true for a person's")] = None
    hands: Annotated[
        bool | None, Meaning("true while somebody has hands at the docks, so that no arm moves")
    ] = None
    north_m: Annotated[float | None, Meaning("the place that a HOLD keeps, north", "m")] = None
    east_m: Annotated[float | None, Meaning("the place that a HOLD keeps, east", "m")] = None

    @property
    def category(self) -> Category:
        is_told = self.state in (StopState.NOT_TAKEN, StopState.NOT_OBEYED, StopState.REFUSED)
        return Category.ALARM if is_told else Category.NEWS

    def text(self) -> str:
        states = {
            StopState.ORDERED: "is ordered",
            StopState.SENT: "is sent",
            StopState.TAKEN: "is taken by the aPad",
            StopState.OBEYED: "slows the aPad",
            StopState.NOT_OBEYED: "is NOT OBEYED",
            StopState.AT_REST: "has brought the aPad to rest",
            StopState.NOT_TAKEN: "is NOT TAKEN by the aPad",
            StopState.REFUSED: "is refused",
        }
        why = f": {self.reason}" if self.reason else ""
        alarms = {
            StopState.NOT_TAKEN: "USE THE VEHICLE'S SWITCH: ",
            StopState.NOT_OBEYED: f"{DOES_NOT_OBEY}: ",
        }
        return f"{alarms.get(self.state, '')}stop {self.number} ({self.mode}, by {self.by}) {states[self.state]}{why}"


@dataclass(frozen=True)
class StopEnded(Event):
    kind = "continued"
    when = "a person let the aPad move again"
    counted = ("number",)
    is_shown_at_once = True
    category = Category.WORD

    number: Annotated[int, Meaning("the stop that ended")]
    by: Annotated[str, Meaning("the person")]

    def text(self) -> str:
        return f"{self.by} continues after stop {self.number}"


@dataclass(frozen=True)
class SentBackIn(Event):
    kind = "back_in"
    when = "a person sent the aPad, which lay just outside the fence, back inside"
    counted = ()
    category = Category.WORD

    by: Annotated[str, Meaning("the person")]
    lookout: Annotated[str, Meaning("who watches the water")]

    def text(self) -> str:
        return f"{self.by} sends the aPad back inside the fence, {self.lookout} watches the water"


@dataclass(frozen=True)
class HoldRepeated(Event):
    kind = "hold_again"
    when = "an aPad that did not take a hold, and has no other order, is ordered to hold again"
    counted = ()
    category = Category.TROUBLE

    north_m: North
    east_m: East

    def text(self) -> str:
        return (
            f"the aPad did not take the hold, and is to hold again at ({self.north_m:g}, {self.east_m:g}) m"
        )


@dataclass(frozen=True)
class Drifting(Event):
    kind = "drift"
    when = "the course of an aPad whose controllers a stop switched off; at once, and every 10 s"
    counted = Uncounted("a sample of the vehicle's motion; the stop before it counts")
    is_shown_at_once = True

    speed_m_s: Annotated[float, Meaning("its last speed, or the known current's", "m/s")]
    towards_rad: Annotated[float, Meaning("its direction, clockwise from north", "rad")]
    fence_s: Annotated[
        float | None, Meaning("the time to the fence or a keep-out zone, if it drifts on", "s")
    ]
    north_m: Annotated[float | None, Meaning("its last place, north", "m")] = None
    east_m: Annotated[float | None, Meaning("its last place, east", "m")] = None
    is_believed: Annotated[bool | None, Meaning("false for a place that is not to be believed")] = None

    def text(self) -> str:
        degrees = round(math.degrees(self.towards_rad)) % 360
        limit = "" if self.fence_s is None else f", at the fence or a keep-out zone in {self.fence_s:.0f} s"
        return f"the aPad drifts without thrust, {self.speed_m_s:.2f} m/s towards {degrees} degrees{limit}"


@dataclass(frozen=True)
class SteeringReported(Event):
    kind = "pilot"
    when = "a pilot takes or leaves the aPad's controls, or nobody tells any more"
    counted = ("steers",)
    category = Category.ALARM

    steers: Annotated[bool | None, Meaning("null when the node that published the pilot's flag is gone")]

    def text(self) -> str:
        if self.steers is None:
            return (
                "whether a pilot steers the aPad cannot be told: nobody publishes the pilot's flag any more"
            )
        return "a pilot steers the aPad" if self.steers else "the pilot has let go of the aPad"


@dataclass(frozen=True)
class WatchdogReported(Event):
    kind = "watchdog"
    when = "the vehicle's own watchdog has stopped watching for 15 s, or watches again"
    counted = ("watches",)
    is_shown_at_once = True

    watches: Annotated[bool, Meaning("false: a lost link or a dead bench would stop nothing")]
    reason: Annotated[str | None, Meaning("why, by its newest state")] = None

    @property
    def category(self) -> Category:
        return Category.RELIEF if self.watches else Category.ALARM

    def text(self) -> str:
        if self.watches:
            return "the vehicle's watchdog watches again"
        return f"{self.reason}: if the link or the bench dies now, nothing stops the aPad"


@dataclass(frozen=True)
class PositionErrorReported(Event):
    kind = "position_error"
    when = "the aPad's position scatters by 1.5 times `guards.position_error_m` and 0.6 m in flight, or less again"
    counted = ("is_above",)
    is_shown_at_once = True

    error_m: Annotated[
        float, Meaning("the error of a position by its noise alone, in 95 % of all cases", "m")
    ]
    expected_m: Annotated[float, Meaning("`guards.position_error_m`", "m")]
    is_above: Annotated[bool, Meaning("true: the clearance of the fence counts on a better position")]

    @property
    def category(self) -> Category:
        return Category.ALARM if self.is_above else Category.RELIEF

    def text(self) -> str:
        if not self.is_above:
            return f"the aPad's position scatters by {self.error_m:.1f} m (95 %) again, and not more"
        return (
            f"the aPad's position scatters by {self.error_m:.1f} m (95 %), and guards.position_error_m is "
            f"{self.expected_m:g} m: the clearance of the fence is too small for it"
        )


@dataclass(frozen=True)
class OthersCommanded(Event):
    kind = "others"
    when = "another client, which is no pilot, gave the aPad an order"
    counted = ()
    category = Category.ALARM

    client: Annotated[str, Meaning("its node; empty where the stack does not tell")]

    def text(self) -> str:
        return f"{self.client or 'a client that this stack does not name'} commands the aPad"
