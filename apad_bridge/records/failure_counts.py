"""Failures of a run by their cause, and the spans in which a person or a guard kept the mission from the aPad."""

from __future__ import annotations

import re
from collections import Counter
from typing import Any

from apad_bridge.events.event import Event
from apad_bridge.events.guard_events import DangerOver, GuardReacted, OrderRefused
from apad_bridge.events.mission_events import (
    PRE_EMPTED,
    BeyondReach,
    DockSwitched,
    InReach,
    LeftAlone,
    PrimitiveChanged,
    PrimitivePhase,
    StepGivenUp,
)
from apad_bridge.events.person_events import Overridden, PersonOrdered
from apad_bridge.events.vehicle_events import DocksDisagree

_TRIES_OF_A_DOCK = 2
"""Failed dockings of a dock that never closed, after which it counts as failed: a single one is a missed aMussel."""
_NUMBER = re.compile(r"\d+(\.\d+)?")
_STOP, _TAKEN, _UNCONFIRMED = "a stop", "an override", "no confirmation"


class FailureCounts:
    """Counts the failures of a run from the journal's events.

    A step that is given up because its primitive failed has one cause with it. Causes that differ in their numbers alone,
    such as the metres left to go, are one, under the text that came first.
    """

    def __init__(self) -> None:
        self.left_alone: set[int] = set()
        """The aMussels that the mission has left alone."""
        self.beyond_reach: set[int] = set()
        """The aMussels that the mission does not serve for the present, because of the way to them."""
        self._causes: Counter[str] = Counter()
        self._texts: dict[str, str] = {}
        self._newest: tuple[int, str] | None = None
        self._failed_dockings: Counter[int] = Counter()
        """Number of failed dockings by dock, of docks that have not closed around any aMussel."""
        self._closed: set[int] = set()

    @property
    def causes(self) -> dict[str, int]:
        """Number of failures by cause, the most frequent first."""
        return {self._texts[cause]: count for cause, count in self._causes.most_common()}

    def take(self, at_ms: int, event: Event) -> None:
        match event:
            case PrimitiveChanged(phase=PrimitivePhase.FAILED, reason=str() as reason) if (
                reason != PRE_EMPTED
            ):
                self._count(reason)
                self._newest = (at_ms, reason)
                if event.name == "dock" and event.dock is not None:
                    self._failed_dockings[event.dock] += 1
            case DockSwitched(closed=True):
                self._closed.add(event.dock)
            case StepGivenUp():
                if self._newest != (at_ms, event.reason):
                    self._count(event.reason)
            case GuardReacted() if self._newest != (at_ms, event.reason):
                self._count(event.reason)  # unless it ended a primitive, whose line has counted it
            case DocksDisagree():
                self._count(event.reason)
            case OrderRefused(order="permit to surface"):
                self._count(event.reason)  # a refused command fails its primitive, whose line is counted
            case LeftAlone():
                self.left_alone.add(event.agent)
            case BeyondReach():
                self.beyond_reach.add(event.agent)
            case InReach():
                self.beyond_reach.discard(event.agent)
            case Overridden(taken=False):
                self.left_alone.clear()  # a person gives them another chance

    def figures(self) -> dict[str, Any]:
        """The keys of summary.json."""
        return {
            "causes": self.causes,
            "left_alone": sorted(self.left_alone),
            "beyond_reach": sorted(self.beyond_reach),
            "failed_docks": sorted(
                dock_index
                for dock_index, tries in self._failed_dockings.items()
                if tries >= _TRIES_OF_A_DOCK and dock_index not in self._closed
            ),
        }

    def _count(self, reason: str) -> None:
        cause = _NUMBER.sub("#", reason)
        self._texts.setdefault(cause, reason)
        self._causes[cause] += 1


class Interruptions:
    """The spans in which a person or a guard kept the mission from the aPad, from the journal's events.

    A span begins with a person's stop, with an override, with a guard's reaction, or with an order that is refused until
    a person confirms it. It ends when the last of these is over: a person continues, the aPad is given back, the danger
    has passed.
    """

    def __init__(self) -> None:
        self._causes: set[str] = set()
        self._since_ms = 0
        self._spans_ms: list[tuple[int, int]] = []

    def take(self, at_ms: int, event: Event) -> None:
        match event:
            case PersonOrdered(order="stop" | "motors off"):
                self._begin(at_ms, _STOP)
            case PersonOrdered(order="continue"):
                self._end(at_ms, *(it for it in self._causes if it != _TAKEN))
            case Overridden(taken=True):
                self._begin(at_ms, _TAKEN)
            case Overridden(taken=False):
                self._end(at_ms, *self._causes)
            case GuardReacted():
                self._begin(at_ms, event.cause)
            case DangerOver():
                self._end(at_ms, event.cause)
            case OrderRefused(guard="person"):
                self._begin(at_ms, _UNCONFIRMED)

    @property
    def is_one(self) -> bool:
        """True while the mission is kept from the aPad, as of the newest event."""
        return bool(self._causes)

    def spans_ms(self, until_ms: int) -> list[tuple[int, int]]:
        """(begin, end) of each span up to a mission time, in order."""
        last = [(self._since_ms, until_ms)] if self._causes else []
        return [*self._spans_ms, *last]

    def stopped_s(self, until_ms: int) -> float:
        return sum(end_ms - begin_ms for begin_ms, end_ms in self.spans_ms(until_ms)) / 1000

    def _begin(self, at_ms: int, cause: str) -> None:
        if not self._causes:
            self._since_ms = at_ms
        self._causes.add(cause)

    def _end(self, at_ms: int, *causes: str) -> None:
        if not self._causes:
            return
        self._causes.difference_update(causes)
        if not self._causes and at_ms > self._since_ms:
            self._spans_ms.append((self._since_ms, at_ms))
