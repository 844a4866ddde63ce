"""Values of the script API: places, believed aMussels, events, statuses. Docks have numbers from 1 here.

Only this file converts a dock's number to its index on the wire, and back.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass
from enum import IntEnum, StrEnum

from agents.time_scale import MissionMs
from apad_bridge.beliefs.belief import Belief
from apad_bridge.vehicle.commands import Manoeuvre
from firmware_model.states import State


class Refused(ValueError):
    """The API cannot do the request. One line states the reason and the remedy. Nothing has changed."""


class Status(IntEnum):
    """Status of a primitive. Field aPads define 0 to 3 (`goto_status`, `docking_status`); 4 is ours."""

    IDLE = 0
    RUNNING = 1
    PREEMPTED = 2
    DONE = 3
    FAILED = 4


@dataclass(frozen=True, slots=True)
class Location:
    """Degrees, and metres north and east of the scenario's origin."""

    lat: float
    lon: float
    north_m: float
    east_m: float


@dataclass(frozen=True, slots=True)
class Agent:
    """The belief about an aMussel. Charges are the paper's scaled voltage; `age_s` is since it was last heard."""

    id: int
    state: str
    battery: float
    secondary: float
    location: Location
    age_s: float
    dock: int | None
    """The dock's number, from 1 on, or None in the water."""


class ScriptEventKind(StrEnum):
    """The kinds of what a script may wait for."""

    GOTO = "goto"
    DOCKING = "docking"
    """A primitive's status changed, as with `goto`: see `status`, and `reason` when it failed."""
    DOCKED = "docked"
    UNDOCKED = "undocked"
    """A mechanism moved, ordered or not, as with `docked`."""
    HEARD = "heard"
    """An aMussel was heard for the first time."""
    STATE = "state"
    """Its believed state changed to `reason`."""
    LOW = "low"
    """Its charge fell to the pool's threshold."""


@dataclass(frozen=True, slots=True)
class ScriptEvent:
    """An event for which a script may wait, at `at_s`. The journal has its own events (`apad_bridge/events/`)."""

    at_s: float
    kind: ScriptEventKind
    agent: int | None = None
    dock: int | None = None
    status: Status | None = None
    reason: str | None = None


def manoeuvre_of(yaw_rate_rad_s: float | None, surge_m_s: float | None) -> Manoeuvre:
    """A Manoeuvre from a script's values; None means the scenario's value. Refused for values not above 0."""
    for what, value in (("yaw rate", yaw_rate_rad_s), ("surge speed", surge_m_s)):
        if value is not None and not 0 < value < math.inf:
            raise Refused(f"a {what} of {value}: it must be above 0, or left out")
    return Manoeuvre(yaw_rate_rad_s, surge_m_s)


def dock_index_of(dock: int, dock_count: int) -> int:
    """The dock index on the wire, from 0 on, of a dock's number, from 1 on. Refused where the aPad has no such dock."""
    if dock not in range(1, dock_count + 1) or isinstance(dock, bool):
        docks = f"the docks are 1 to {dock_count}" if dock_count > 1 else "the only dock is 1"
        raise Refused(f"there is no dock {dock!r}: {docks}")
    return dock - 1


def dock_of(dock_index: int) -> int:
    """The number, from 1 on, of a dock index, from 0 on."""
    return dock_index + 1


# Keeps events for scripts until they take them: from the port's outcomes and from changed beliefs.
MAX_EVENTS = 10_000
"""The log forgets the oldest events beyond so many."""


class EventLog:
    def __init__(self, low: float) -> None:
        self._low = low
        self._events: deque[ScriptEvent] = deque(maxlen=MAX_EVENTS)
        self.failure: str | None = None
        """The reason of the last failed primitive."""
        self._seen: dict[int, tuple[State, bool]] = {}

    def record(
        self,
        now_ms: MissionMs,
        kind: ScriptEventKind,
        agent: int | None = None,
        dock: int | None = None,
        status: Status | None = None,
        reason: str | None = None,
    ) -> None:
        if status is Status.FAILED:
            self.failure = reason
        self._events.append(ScriptEvent(now_ms / 1000, kind, agent, dock, status, reason))

    def compare(self, beliefs: Iterable[Belief], now_ms: MissionMs) -> None:
        """Compares the beliefs with the beliefs of the last call and records the changes."""
        for belief in beliefs:
            now = (belief.state, belief.primary <= self._low)
            before = self._seen.get(belief.agent_id)
            if before == now:
                continue
            self._seen[belief.agent_id] = now
            if before is None:
                self.record(now_ms, ScriptEventKind.HEARD, belief.agent_id)
            elif before[0] is not now[0]:
                self.record(now_ms, ScriptEventKind.STATE, belief.agent_id, reason=now[0].name)
            if now[1] and (before is None or not before[1]):
                self.record(now_ms, ScriptEventKind.LOW, belief.agent_id)

    def take(self, kind: str | None = None, agent: int | None = None) -> list[ScriptEvent]:
        """Removes and returns the events of a kind and an aMussel (None: of all); the others stay."""
        _refuse_unknown(kind)
        wanted: list[ScriptEvent] = []
        remaining: list[ScriptEvent] = []
        for event in self._events:
            (wanted if kind in (None, event.kind) and agent in (None, event.agent) else remaining).append(
                event
            )
        self._events = deque(remaining, maxlen=MAX_EVENTS)
        return wanted

    def take_first(self, kind: str | None = None, agent: int | None = None) -> ScriptEvent | None:
        """Removes and returns the oldest such event."""
        _refuse_unknown(kind)
        for event in self._events:
            if kind in (None, event.kind) and agent in (None, event.agent):
                self._events.remove(event)
                return event
        return None


def _refuse_unknown(kind: str | None) -> None:
    if kind is not None and kind not in list(ScriptEventKind):
        raise Refused(f"there are no events {kind!r}: the kinds are {', '.join(ScriptEventKind)}")
