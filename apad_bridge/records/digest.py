"""One number for what a flight decided and what happened in it, by which two runs compare on any two machines.

Each counted event has a canonical text: its mission time, its kind, and the fields that its class names as `counted`. The
digest is the sum of the texts' hashes, so the order of lines of the same time does not matter. It follows neither the wall
clock, nor paths, nor versions, nor the form of the journal. A new field counts once its class names it.

Places count to the centimetre, and charges to a thousandth: the last bits of a float may follow the processor.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Mapping
from hashlib import blake2b
from typing import Any, NamedTuple

from apad_bridge.events.all_events import EVENTS
from apad_bridge.events.event import Event, Uncounted
from apad_bridge.events.fleet_events import TruthChanged
from apad_bridge.events.mission_events import LegBegan, MissionChanged, PlanMade
from apad_bridge.events.sound_events import PacketPassed, RangeMeasured
from firmware_model.power.charge import fraction

Facts = Mapping[str, Any]
Chosen = Callable[["RunDigest", Facts], Facts | None]
_BYTES = 8


class CountedEvent(NamedTuple):
    """A counted event; sorted by its time."""

    at_ms: int
    kind: str
    facts: str
    """JSON, with sorted keys."""

    def __str__(self) -> str:
        return f"{self.at_ms / 1000:.3f} s, {self.kind}: {self.facts}"


class RunDigest:
    """Takes a run's events, for each aMussel in order of time."""

    def __init__(self) -> None:
        self._sum = 0
        self._states: dict[int, tuple[str, bool]] = {}
        self._phase: str | None = None

    def __str__(self) -> str:
        return _text(self._sum)

    def take(self, at_ms: int, event: Event) -> CountedEvent | None:
        """Counts an event and returns it; None for one that does not count."""
        choose = COUNTED.get(event.kind)
        facts = None if choose is None else choose(self, event.data)
        if facts is None:
            return None
        counted = CountedEvent(at_ms, event.kind, json.dumps(facts, sort_keys=True, separators=(",", ":")))
        text = f"{counted.at_ms} {counted.kind} {counted.facts}".encode()
        self._sum += int.from_bytes(blake2b(text, digest_size=_BYTES).digest(), "big")
        return counted

    def truth(self, data: Facts) -> Facts | None:
        """A truth counts where an aMussel's state changed, or a dock closed or opened around it."""
        now = (data["state"], data["docked"])
        if self._states.get(data["id"]) == now:
            return None
        self._states[data["id"]] = now
        return {
            **_picked(data, ("id", "agent_ms", "state", "docked")),
            "north_cm": _nearest(data["north_um"] / 10_000),
            "east_cm": _nearest(data["east_um"] / 10_000),
            # Of the batteries' anchors; the charge at any time follows from them.
            "primary": _nearest(1000 * fraction(data["primary"][1])),
            "secondary": _nearest(1000 * fraction(data["secondary"][1])),
        }

    def mission(self, data: Facts) -> Facts | None:
        """The mission's state counts where its phase changed: the other events have the rest."""
        if data["phase"] == self._phase:
            return None
        self._phase = data["phase"]
        return {"phase": data["phase"]}


def combined_digest(digests: Iterable[str]) -> str:
    """The one digest of a run of several aPads, from theirs."""
    return _text(sum(int(digest, 16) for digest in digests))


def counted_events(entries: Iterable[tuple[int, Event]]) -> tuple[list[CountedEvent], str]:
    """The counted events of a journal, sorted, and their digest."""
    digest = RunDigest()
    taken = (digest.take(at_ms, event) for at_ms, event in entries)
    return sorted(event for event in taken if event is not None), str(digest)


def _text(total: int) -> str:
    return f"{total % (1 << 8 * _BYTES):0{2 * _BYTES}x}"


def _nearest(value: float) -> int:
    """The nearest whole number, with the border between two at 0.49.

    At a half it would part equal runs: a place of 12.345 m lies there, and its last bit may follow the processor.
    """
    return round(value + 0.01)


def _picked(data: Facts, names: Iterable[str]) -> dict[str, Any]:
    """The named facts that the line has; metres in whole centimetres."""
    found = {name: data[name] for name in names if data.get(name) is not None}
    return dict(
        (f"{name[:-2]}_cm", _nearest(100 * value)) if name.endswith("_m") else (name, value)
        for name, value in found.items()
    )


def _only(*names: str) -> Chosen:
    return lambda _, data: _picked(data, names)


def _plan(_: RunDigest, data: Facts) -> Facts:
    return {
        "what": data["what"],
        "strategy": data["strategy"],
        "steps": [[step["agent"], step["dock"]] for step in data["steps"]],
        "exchanged": [[it["released"], it["collected"]] for it in data.get("exchanged", ())],
    }


def _leg(_: RunDigest, data: Facts) -> Facts:
    return {"cm": _nearest(100 * data["metres"])}


def _packet(_: RunDigest, data: Facts) -> Facts:
    """Levels and ways are left out, and so is the payload, which a codec of one's own may change."""
    return {
        **_picked(data, ("from", "address", "what", "began_ms", "timeslot")),
        "sent": data["unsent"] is None,
        "heard": sorted([listener, outcome] for listener, outcome, *_ in data["heard"]),
    }


def _range(_: RunDigest, data: Facts) -> Facts:
    return {"id": data["id"], "answered": data["range_m"] is not None}


_OWN_FORM: Mapping[str, Chosen] = {
    TruthChanged.kind: RunDigest.truth,
    MissionChanged.kind: RunDigest.mission,
    PlanMade.kind: _plan,
    LegBegan.kind: _leg,
    PacketPassed.kind: _packet,
    RangeMeasured.kind: _range,
}
"""The kinds whose counted fields are rounded, or count at changes alone."""


def _chosen(kind: str) -> Chosen | None:
    """The choice of facts, by the event's class; None for a kind that does not count."""
    found = EVENTS.get(kind)
    if found is None or isinstance(found.counted, Uncounted):
        return None
    return _OWN_FORM.get(kind) or _only(*found.counted)


COUNTED: Mapping[str, Chosen] = {kind: it for kind in EVENTS if (it := _chosen(kind)) is not None}
"""The choice of facts, by kind."""
