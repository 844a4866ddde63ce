"""All kinds of events: the closed union, by kind."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from apad_bridge.events import fleet, graph, guards, mission, persons, run, sound, vehicle
from apad_bridge.events.event import Event

_FAMILIES = (run, mission, persons, guards, vehicle, fleet, sound, graph)

EVENTS: dict[str, type[Event]] = {
    it.kind: it
    for family in _FAMILIES
    for it in vars(family).values()
    if isinstance(it, type) and issubclass(it, Event) and it is not Event
}
"""The class of each kind, in the order of docs/records.md."""


def event_of(kind: str, data: Mapping[str, Any]) -> Event:
    """The event of a journal's line; KeyError for a kind unknown here."""
    return EVENTS[kind].of(data)


def told_event(line: Mapping[str, Any]) -> Event | None:
    """The event of a journal's line, if its kind has a text for people; None for samples and for kinds unknown here."""
    found = EVENTS.get(line["kind"])
    return None if found is None or found.text is Event.text else found.of(line)
