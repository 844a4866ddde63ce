"""All kinds of events: the closed union, by kind."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from apad_bridge.events import (
    fleet_events,
    graph_events,
    guard_events,
    mission_events,
    person_events,
    run_events,
    sound_events,
    vehicle_events,
)
from apad_bridge.events.event import Event, Uncounted

_FAMILIES = (
    run_events,
    mission_events,
    person_events,
    guard_events,
    vehicle_events,
    fleet_events,
    sound_events,
    graph_events,
)

EVENTS: dict[str, type[Event]] = {
    it.kind: it
    for family in _FAMILIES
    for it in vars(family).values()
    if isinstance(it, type) and issubclass(it, Event) and it is not Event
}
"""The class of each kind, in the order of docs/reference/journal.md."""


@dataclass(frozen=True)
class UnknownEvent(Event):
    """An event of a kind that another version knows. It is in no table, and keeps its fields as they are."""

    kind = "unknown"
    when = "another version saw it"
    counted = Uncounted("the meaning of its fields is unknown")

    named: str
    """Its own kind, which an instance has as its `kind`."""
    fields: Mapping[str, Any]

    def __post_init__(self) -> None:
        object.__setattr__(self, "kind", self.named)

    @property
    def data(self) -> dict[str, Any]:
        return dict(self.fields)


def event_of(kind: str, data: Mapping[str, Any]) -> Event:
    """The event of a journal's line."""
    if (found := EVENTS.get(kind)) is not None:
        return found.of(data)
    return UnknownEvent(kind, {name: it for name, it in data.items() if name not in ("t", "kind")})
