"""The stops of one vehicle: each has a number, a kind, and the states that it went through, until a person continues.

HOLD keeps the place by the thrusters. It needs a position that is believed, inside the waters. OFF is no thrust: the water
takes the vehicle. A stop is *ordered* when somebody wants it, *sent* when the order leaves, *taken* when the vehicle has
accepted it, *obeyed* when the hull slows, and the vehicle is *at rest* when its position no longer changes. Only a stop
that is obeyed is done. The hull may also *not obey* (`obedience.py`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import StrEnum

from apad_bridge.events.event import Event
from apad_bridge.events.guard_events import StopChanged, StopEnded, StopKind, StopState
from apad_bridge.vehicle.guards.guarded_orders import Point

TAKEN_MS = 3_000
"""A stop that a real vehicle has not taken so long after its sending is reported, and a HOLD becomes OFF."""
SIMULATED_TAKEN_MS = 60_000
"""The same for a simulated vehicle, whose clock may run far ahead of its messages."""


class StopsEnded(StrEnum):
    """The stops in force that a person's word ends."""

    ANY = "any"
    """The word is to continue."""
    PERSONS_HOLD = "a person's hold"
    """The word is another order to move, which comes after a person's HOLD. A guard's stop and an OFF stay."""
    NONE = "none"
    """The person has only said who commands the vehicle."""


class Latch:
    """A number that grows whenever the right to move the vehicle changes. An order leaves only under its own number.

    One thread turns it, and any thread may read it.
    """

    def __init__(self) -> None:
        self.number = 0

    def turn(self) -> None:
        """A stop began, became OFF or ended, or a pilot or another party came or left."""
        self.number += 1


@dataclass(frozen=True, slots=True)
class StopRecord:
    """Times are mission ms; None before the state came."""

    number: int
    kind: StopKind
    by: str
    """The person's name, or `guard: CAUSE`."""
    reason: str
    ordered_ms: int
    is_persons: bool = False
    sent_ms: int | None = None
    taken_ms: int | None = None
    obeyed_ms: int | None = None
    rest_ms: int | None = None
    not_obeyed: str = ""
    """The reason to say that the hull goes on in spite of the stop; empty while it obeys, or nobody can tell yet."""
    unobserved: str = ""
    """The reason why nobody can tell if the hull obeys a stop that was taken; empty where somebody can."""
    place_m: Point | None = None
    """The place (north, east) that a HOLD keeps: the one where it first went out."""
    not_taken: str = ""
    """The reason why the vehicle has not taken it; empty while it may still do so."""
    refused: str = ""
    """The reason why nothing was sent: a pilot steers."""
    stills_arms: bool = False
    """Somebody has hands at the docks: no arm moves."""
    states: tuple[tuple[StopState, int], ...] = ()
    """Each state that it came to, with its time."""
    newest_reason: str = ""
    """The newest reason that came with one of them; empty where none did."""

    @property
    def state(self) -> StopState:
        if self.refused:
            return StopState.REFUSED
        if self.not_obeyed:
            return StopState.NOT_OBEYED
        if self.rest_ms is not None:
            return StopState.AT_REST
        if self.obeyed_ms is not None:
            return StopState.OBEYED
        if self.taken_ms is not None:
            return StopState.TAKEN
        if self.not_taken:
            return StopState.NOT_TAKEN
        return StopState.ORDERED if self.sent_ms is None else StopState.SENT

    def text(self) -> str:
        why = f": {self.reason}" if self.reason else ""
        return f"stop {self.number} ({self.kind}, by {self.by}) is in force{why}"


@dataclass(frozen=True, slots=True)
class StopsState:
    """The newest stop and the one in force, by the journal's lines of stops: the same live, resumed, and on the page."""

    newest: StopRecord | None = None
    in_force: StopRecord | None = None
    """Nothing but this stop moves or stills the vehicle, until a person continues."""

    def after(self, at_ms: int, event: StopChanged | StopEnded) -> StopsState:
        """The stops after the next event of one, at its mission time."""
        if isinstance(event, StopEnded):
            return replace(self, in_force=None)
        changed = _changed(self.in_force, event, at_ms)
        # A refused stop has a number of its own, which no other gets while an older one is in force.
        newest = self.newest if self.newest and self.newest.number > changed.number else changed
        return StopsState(newest, self.in_force if event.state is StopState.REFUSED else changed)

    @property
    def next_number(self) -> int:
        return 1 if self.newest is None else self.newest.number + 1

    def text(self) -> str:
        """A line for the person who resumes the run; empty without a stop in force."""
        if (stop := self.in_force) is None:
            return ""
        what = "hands at the docks" if stop.stills_arms else f"stopped ({stop.kind})"
        seconds = stop.ordered_ms // 1000
        since = f"{seconds // 3600}:{seconds // 60 % 60:02}:{seconds % 60:02}"
        return (
            f"{what}, by {stop.by}, since {since} of mission time: nothing moves until `musselbed continue`"
        )


NO_STOPS = StopsState()


def _changed(before: StopRecord | None, event: StopChanged, at_ms: int) -> StopRecord:
    """The record of a stop after one line of the journal."""
    place_m = None if event.north_m is None or event.east_m is None else (event.north_m, event.east_m)
    if before is None or before.number != event.number or event.state is StopState.REFUSED:
        before = StopRecord(event.number, event.mode, event.by, event.reason or "", at_ms)
    changed = replace(
        before,
        kind=event.mode,
        is_persons=bool(event.is_persons),
        stills_arms=bool(event.hands),
        place_m=place_m if event.mode is StopKind.HOLD else None,
        states=(*before.states, (event.state, at_ms)),
        newest_reason=event.reason or before.newest_reason,
    )
    match event.state:
        case StopState.ORDERED:
            return replace(changed, sent_ms=None, taken_ms=None, obeyed_ms=None, rest_ms=None)
        case StopState.SENT:
            return replace(changed, sent_ms=at_ms)
        case StopState.TAKEN:
            return replace(changed, taken_ms=at_ms, not_taken="")
        case StopState.OBEYED:
            return replace(changed, obeyed_ms=at_ms, not_obeyed="")
        case StopState.NOT_OBEYED:
            return replace(changed, not_obeyed=event.reason or "", obeyed_ms=None, rest_ms=None)
        case StopState.AT_REST:
            return replace(changed, rest_ms=at_ms)
        case StopState.NOT_TAKEN:
            return replace(changed, not_taken=event.reason or "")
        case StopState.REFUSED:
            return replace(changed, refused=event.reason or "")


class Stops:
    """Keeps the stops of a vehicle. It sends nothing: a `GuardedVehicle` does, and says what came of it.

    Only the lines that it writes change them, and one assignment each: another thread reads a whole state.
    """

    def __init__(self, events: list[Event], latch: Latch) -> None:
        self._events = events
        """The journal's lines that nobody has taken yet; the gate's too."""
        self._latch = latch
        self._state = NO_STOPS
        self.way_back: int | None = None
        """The id of the way back inside the fence, which a person allowed while the stop is in force."""
        self._command_id: int | None = None
        """The command by which the stop in force went out last."""
        self._needs_word: int | None = None
        """The number of the stop in force if the word to continue alone ends it, although it is a person's HOLD: a former
        supervisor left it, or it came in the place of a stop that such a word alone ends."""
        self._is_reported = False
        """The operator was told that the vehicle has not taken it, in this mode."""
        self._awaited_ms: int | None = None
        """Since when the vehicle owes its acceptance, of which the operator was not told. A HOLD that becomes OFF
        meanwhile, or a second stop, gives it no more time."""

    @property
    def newest(self) -> StopRecord | None:
        return self._state.newest

    @property
    def in_force(self) -> StopRecord | None:
        return self._state.in_force

    @property
    def is_persons_hold(self) -> bool:
        """The stop in force is a person's HOLD, which another word of a person ends.

        One that outlived a crash is none, and neither is one that a person ordered while a guard's stop was in force.
        """
        stop = self.in_force
        if stop is None or stop.stills_arms or stop.number == self._needs_word:
            return False
        return stop.is_persons and stop.kind is StopKind.HOLD

    @property
    def keeps_still(self) -> bool:
        """A person's stop is in force and has done its work. The water may carry a hull without thrust on."""
        stop = self.in_force
        if stop is None or not stop.is_persons or self.way_back is not None:
            return False
        return (stop.rest_ms if stop.kind is StopKind.HOLD else stop.obeyed_ms) is not None

    def may_end(self, number: int | None, ends: StopsEnded) -> bool:
        """True where no stop is in force, or the one of this number, and a word of this kind ends it."""
        if self.in_force is None:
            return True
        if self.in_force.number != number:
            return False
        return ends is StopsEnded.ANY or (ends is StopsEnded.PERSONS_HOLD and self.is_persons_hold)

    def begin(
        self,
        kind: StopKind,
        by: str,
        reason: str,
        now_ms: int,
        *,
        is_persons: bool = False,
        stills_arms: bool = False,
    ) -> None:
        """A new stop is ordered, and is in force. It stills the arms if the one before it did."""
        stills = stills_arms or (self.in_force is not None and self.in_force.stills_arms)
        if self.in_force is not None and not self.is_persons_hold:
            self._needs_word = self._state.next_number
        self._latch.turn()
        self._command_id, self._is_reported = None, False
        stop = StopRecord(
            self._state.next_number, kind, by, reason, now_ms, is_persons=is_persons, stills_arms=stills
        )
        self._emit(stop, StopState.ORDERED, now_ms, reason)

    def refuse(self, kind: StopKind, by: str, reason: str, now_ms: int) -> None:
        """Somebody wants a stop, and nothing may be sent, for this reason."""
        stop = StopRecord(self._state.next_number, kind, by, reason, now_ms, is_persons=True)
        self._emit(stop, StopState.REFUSED, now_ms, reason)

    def become_off(self, reason: str, now_ms: int) -> None:
        """A HOLD in force becomes OFF, for this reason, under the same number."""
        assert self.in_force is not None
        self._latch.turn()
        self._is_reported = False
        off = replace(self.in_force, kind=StopKind.OFF, place_m=None)
        self._emit(off, StopState.ORDERED, now_ms, reason)

    def order_again(self, reason: str, now_ms: int) -> None:
        """The vehicle moves in spite of the stop, for this reason: what it had taken it has to take anew."""
        if self.in_force is not None and self.in_force.taken_ms is not None:
            self._is_reported = False
            self._emit(self.in_force, StopState.ORDERED, now_ms, reason)

    def sent(self, command_id: int, now_ms: int, here_m: Point | None) -> None:
        """The stop in force goes out by this command. A HOLD keeps the place where the vehicle is then."""
        stop = self.in_force
        assert stop is not None
        self._command_id = command_id
        if self._awaited_ms is None and stop.taken_ms is None:
            self._awaited_ms = now_ms
        if stop.sent_ms is None:
            place_m = (stop.place_m or here_m) if stop.kind is StopKind.HOLD else None
            self._emit(replace(stop, place_m=place_m), StopState.SENT, now_ms)

    def is_sent_by(self, command_id: int) -> bool:
        return self.in_force is not None and self._command_id == command_id

    def taken(self, now_ms: int) -> None:
        if self.in_force is not None and self.in_force.taken_ms is None:
            self._awaited_ms = None
            self._emit(self.in_force, StopState.TAKEN, now_ms)

    def failed(self, reason: str, now_ms: int) -> None:
        """The vehicle has not taken it, and it is sent again; told once."""
        if self.in_force is not None and self.in_force.taken_ms is None and not self._is_reported:
            self._is_reported, self._awaited_ms = True, None
            self._emit(self.in_force, StopState.NOT_TAKEN, now_ms, reason)

    def obeyed(self, now_ms: int) -> None:
        """The hull slows, or was slow when the stop was taken."""
        if self.in_force is not None and self.in_force.obeyed_ms is None:
            self._emit(self.in_force, StopState.OBEYED, now_ms)

    def blind(self, reason: str) -> None:
        """Nobody can tell if the hull obeys, for this reason; empty where somebody can again. The journal keeps it not."""
        stop = self.in_force
        if stop is not None and stop.taken_ms is not None and bool(stop.unobserved) != bool(reason):
            blind = replace(stop, unobserved=reason)
            self._state = StopsState(blind if self.newest is stop else self.newest, blind)

    def disobeyed(self, reason: str, now_ms: int) -> None:
        """The hull goes on in spite of the stop, for this reason; told once."""
        if self.in_force is not None and not self.in_force.not_obeyed:
            self._emit(self.in_force, StopState.NOT_OBEYED, now_ms, reason)

    def at_rest(self, now_ms: int) -> None:
        stop = self.in_force
        if stop is not None and stop.obeyed_ms is not None and stop.rest_ms is None:
            self._emit(stop, StopState.AT_REST, now_ms)

    def is_overdue(self, now_ms: int, patience_ms: int = TAKEN_MS) -> bool:
        """The stop in force was sent, and the vehicle has not taken it in time."""
        stop = self.in_force
        return (
            stop is not None
            and stop.taken_ms is None
            and not self._is_reported
            and self._awaited_ms is not None
            and now_ms - self._awaited_ms >= patience_ms
        )

    def end(self, by: str, now_ms: int) -> None:
        """A person continues: no stop is in force any more."""
        if self.in_force is not None:
            self._latch.turn()
            self._take(StopEnded(self.in_force.number, by), now_ms)
        self._command_id = self._awaited_ms = None

    def restore(self, restored: StopsState) -> None:
        """Takes over the stops of the run's former supervisor."""
        self._state = restored
        self._needs_word = None if restored.in_force is None else restored.in_force.number
        self._latch.turn()

    def _emit(self, stop: StopRecord, state: StopState, now_ms: int, reason: str = "") -> None:
        """A stop came to a state, for this reason."""
        north_m, east_m = (None, None) if stop.place_m is None else (round(it, 3) for it in stop.place_m)
        changed = StopChanged(
            stop.number,
            stop.kind,
            stop.by,
            state,
            reason or None,
            is_persons=stop.is_persons or None,
            hands=stop.stills_arms or None,
            north_m=north_m,
            east_m=east_m,
        )
        self._take(changed, now_ms)

    def _take(self, event: StopChanged | StopEnded, now_ms: int) -> None:
        self._state = self._state.after(now_ms, event)
        self._events.append(event)
