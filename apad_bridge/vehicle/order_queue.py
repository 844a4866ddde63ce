"""The one queue by which orders leave for a vehicle, which a stop empties. No sockets, no threads.

An order was let out at one time and leaves at another. So the queue asks the gate again directly before an order leaves
(`lets_go`). A stop goes before everything that waits, and first ends each older order under way: a HOLD ends orders, an OFF
ends HOLDs, too. So no bytes of an older order follow those of a stop.

One thread owns a queue. It passes in what came of its actions, and `advance` returns the next ones. Each order has a line,
which carries one call at a time; a stop has lines of its own, so that it finds them free. Times are ms of a clock that
never goes back. Every wait ends: an order waits `PATIENCE_MS` to leave and for its answer, a stop `STOP_PATIENCE_MS`. A
closed line is opened again every `REOPEN_MS`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum, IntEnum, auto
from typing import Any

from apad_bridge.vehicle.vehicle_link import Cleared

PATIENCE_MS = 5_000
STOP_PATIENCE_MS = 3_000
REOPEN_MS = 2_000

REPLACED = "a newer order replaced it before it left"
STOPPED_BEFORE = "a stop came before it left"
CUT = "a stop ended it on its way"
CLOSED = "the connection ended"
TOO_LATE = "the vehicle did not answer in time"


class Rank(IntEnum):
    """An order of a higher rank ends those of a lower one."""

    ORDER = 0
    HOLD = 1
    OFF = 2


@dataclass(frozen=True, slots=True, eq=False)
class Outgoing:
    """An order on its way to a vehicle, and the line by which it goes."""

    cleared: Cleared[Any]
    rank: Rank
    line: str


@dataclass(frozen=True, slots=True)
class OpenLine:
    line: str


@dataclass(frozen=True, slots=True)
class CutLine:
    """End the line with all that it holds: nothing of it may leave any more."""

    line: str


@dataclass(frozen=True, slots=True)
class Write:
    outgoing: Outgoing


@dataclass(frozen=True, slots=True)
class Ended:
    """An order is over: `refused` is the reason, None for one that the vehicle has taken."""

    outgoing: Outgoing
    refused: str | None


QueueAction = OpenLine | CutLine | Write | Ended


class _LineState(Enum):
    CLOSED = auto()
    OPENING = auto()
    FREE = auto()
    BUSY = auto()
    """It carries `call`, whose answer is awaited until `until_ms`."""


@dataclass(slots=True)
class _Line:
    name: str
    state: _LineState = _LineState.CLOSED
    call: Outgoing | None = None
    until_ms: int = 0
    """The end of the wait for an answer; of a closed line, the time from which on it is opened."""
    answers: bool = True
    """False for a line that only carries orders away, as a topic does."""
    newest: Rank = Rank.OFF
    """The rank of the newest order that it carried away."""

    def may_hold_bytes_older_than(self, stop: Outgoing) -> bool:
        """A HOLD follows the orders on their own line, and so does an OFF on its own."""
        is_other = stop.rank is Rank.OFF and self.name != stop.line
        return is_other and not self.answers and self.newest < Rank.OFF


@dataclass(slots=True)
class _Waiting:
    outgoing: Outgoing
    until_ms: int


class OrderQueue:
    """Keeps at most one order that waits, the newest, and one stop of each line. `lets_go` is the gate's last word."""

    def __init__(self, lets_go: Callable[[Cleared[Any]], bool]) -> None:
        self._lets_go = lets_go
        self._lines: dict[str, _Line] = {}
        self._order: _Waiting | None = None
        self._stops: dict[str, _Waiting] = {}
        """By line, in the order in which they came."""
        self._again: Outgoing | None = None
        """The order that goes out once more, because its line had ended at the vehicle meanwhile."""
        self._actions: list[QueueAction] = []

    def add_line(self, name: str, *, answers: bool = True) -> None:
        """Adds a line, closed; one that does not answer is open for ever."""
        state = _LineState.CLOSED if answers else _LineState.FREE
        self._lines[name] = _Line(name, state, answers=answers)

    def is_open(self, name: str) -> bool:
        return self._lines[name].state in (_LineState.FREE, _LineState.BUSY)

    def put(self, outgoing: Outgoing, now_ms: int) -> None:
        """Takes an order. One that waits makes way for it; a stop ends what is under way, too."""
        if self._order is not None:
            before, self._order = self._order.outgoing, None
            self._end(before, REPLACED if outgoing.rank is Rank.ORDER else STOPPED_BEFORE)
        if outgoing.rank is Rank.ORDER:
            self._order = _Waiting(outgoing, now_ms + PATIENCE_MS)
            return
        for name, waiting in list(self._stops.items()):
            if waiting.outgoing.rank < outgoing.rank or name == outgoing.line:
                del self._stops[name]
                self._end(waiting.outgoing, STOPPED_BEFORE)
        for line in self._lines.values():
            if line.call is not None and line.call.rank < outgoing.rank:
                self._cut(line, CUT, now_ms)
            elif line.may_hold_bytes_older_than(outgoing):
                self._actions.append(CutLine(line.name))
        self._stops[outgoing.line] = _Waiting(outgoing, now_ms + STOP_PATIENCE_MS)

    def opened(self, name: str) -> None:
        self._lines[name].state = _LineState.FREE

    def not_opened(self, name: str, reason: str, now_ms: int) -> None:
        """The line could not be opened. An order that needs it at once has failed; a stop waits on."""
        line = self._lines[name]
        line.state, line.until_ms = _LineState.CLOSED, now_ms + REOPEN_MS
        if self._order is not None and self._order.outgoing.line == name:
            order, self._order = self._order.outgoing, None
            self._end(order, reason)
        if name in self._stops:
            line.until_ms = now_ms + REOPEN_MS // 4

    def answered(self, name: str, refused: str | None) -> None:
        """The vehicle has answered the line's call. An answer without a call changes nothing."""
        line = self._lines[name]
        if line.call is not None:
            call, line.call, line.state = line.call, None, _LineState.FREE
            self._end(call, refused)

    def ended(self, name: str, now_ms: int) -> None:
        """The line has ended at its other end. Its call goes out once more by a new one, if nothing newer waits."""
        line = self._lines[name]
        call, line.call = line.call, None
        line.state, line.until_ms = _LineState.CLOSED, now_ms
        if call is None:
            return
        if call is self._again or self._stops or (call.rank is Rank.ORDER and self._order is not None):
            self._end(call, CLOSED)
            return
        self._again = call
        if call.rank is Rank.ORDER:
            self._order = _Waiting(call, now_ms + PATIENCE_MS)
        else:
            self._stops[name] = _Waiting(call, now_ms + STOP_PATIENCE_MS)

    def advance(self, now_ms: int) -> list[QueueAction]:
        """The next actions, to be done in this order before anything else is passed in."""
        self._time_out(now_ms)
        for name, waiting in list(self._stops.items()):
            if self._lines[name].state is _LineState.FREE:
                del self._stops[name]
                self._leave(waiting.outgoing, STOP_PATIENCE_MS, now_ms)
        is_busy = any(it.call is not None for it in self._lines.values())
        order = self._order
        if order is not None and not is_busy and self._lines[order.outgoing.line].state is _LineState.FREE:
            self._order = None
            self._leave(order.outgoing, PATIENCE_MS, now_ms)
        for line in self._lines.values():
            if line.state is _LineState.CLOSED and line.until_ms <= now_ms:
                line.state = _LineState.OPENING
                self._actions.append(OpenLine(line.name))
        actions, self._actions = self._actions, []
        return actions

    def next_due_ms(self) -> int | None:
        """The time at which `advance` has something to do by itself; None for none."""
        due = [it.until_ms for it in self._lines.values() if it.state in (_LineState.BUSY, _LineState.CLOSED)]
        due += [it.until_ms for it in (*self._stops.values(), *([self._order] if self._order else ()))]
        return min(due, default=None)

    def _time_out(self, now_ms: int) -> None:
        for line in self._lines.values():
            if line.call is not None and line.until_ms <= now_ms:
                self._cut(line, TOO_LATE, now_ms)
        for name, waiting in list(self._stops.items()):
            if waiting.until_ms <= now_ms:
                del self._stops[name]
                self._end(
                    waiting.outgoing, f"no connection to the vehicle within {STOP_PATIENCE_MS / 1000:g} s"
                )
        if self._order is not None and self._order.until_ms <= now_ms:
            order, self._order = self._order.outgoing, None
            self._end(order, f"it could not leave within {PATIENCE_MS / 1000:g} s")

    def _leave(self, outgoing: Outgoing, patience_ms: int, now_ms: int) -> None:
        if not self._lets_go(outgoing.cleared):
            self._end(outgoing, STOPPED_BEFORE)
            return
        line = self._lines[outgoing.line]
        line.newest = outgoing.rank
        self._actions.append(Write(outgoing))
        if line.answers:
            line.state, line.call, line.until_ms = _LineState.BUSY, outgoing, now_ms + patience_ms
        else:
            self._end(outgoing, None)

    def _cut(self, line: _Line, reason: str, now_ms: int) -> None:
        call, line.call = line.call, None
        line.state, line.until_ms = _LineState.CLOSED, now_ms
        self._actions.append(CutLine(line.name))
        if call is not None:
            self._end(call, reason)

    def _end(self, outgoing: Outgoing, refused: str | None) -> None:
        self._actions.append(Ended(outgoing, refused))
