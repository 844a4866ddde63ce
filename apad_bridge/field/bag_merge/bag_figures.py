"""The figures of a run, counted again from a bag alone: from samples of its aMussels, and from the mission's events.

The samples are those of the truth, which a run's own bag has. A bag that was recorded on the graph has beliefs, and then
the believed uptime. A bag that lacks ticks gives figures of the ticks that it has, and says how many those are.
"""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

from apad_bridge.events.mission_events import AMusselReleased, MissionChanged
from apad_bridge.events.run_events import RunEnded
from apad_bridge.records.bag import RecordedTypes, recorded_messages
from apad_bridge.records.bag_messages import BELIEFS, EVENT, TRUTH
from firmware_model.state_groups import DOCKED

_SAMPLES = {"truth": TRUTH, "beliefs": BELIEFS}
"""The kinds of samples, the better one first."""


@dataclass(frozen=True, slots=True)
class RunFigures:
    """Figures with the names and meanings of summary.json; None for those that the bag does not hold."""

    samples: str | None
    """Source of the uptimes: `truth` or `beliefs`."""
    ticks: int
    """Mission times of which the bag has a sample."""
    ticks_missing: int
    """Ticks between its first and its last sample that it lacks."""
    uptime_paper_mean: float | None
    """In percent."""
    uptime_paper_max: float | None
    uptime_paper_min: float | None
    cost_m: float | None
    services: int
    events: int
    ended_by: str | None


class _Uptimes:
    """The ticks of one kind of sample at which each aMussel was seen, and was up."""

    def __init__(self, is_up: Callable[[Any], bool]) -> None:
        self.times_ms: set[int] = set()
        self.seen: Counter[int] = Counter()
        self.up: Counter[int] = Counter()
        self._is_up = is_up

    def take(self, message: Any) -> None:
        # The mission's ticks begin after its start, as in summary.json.
        if message.mission_time_ms == 0 or message.mission_time_ms in self.times_ms:
            return
        self.times_ms.add(message.mission_time_ms)
        for row in message.agents:
            self.seen[row.id] += 1
            self.up[row.id] += self._is_up(row)


class _Events:
    def __init__(self) -> None:
        self.events: set[tuple[int, str, str]] = set()
        self.cost_m: float | None = None
        self.services = 0
        self.ended_by: str | None = None

    def take(self, message: Any) -> None:
        event = message.mission_time_ms, message.kind, message.data
        if event in self.events:
            return
        self.events.add(event)
        try:
            data = json.loads(message.data)
        except ValueError:
            return
        match message.kind, data:
            case MissionChanged.kind, {"snapshot": {"cost_m": float() | int() as cost_m}}:
                self.cost_m = max(cost_m, self.cost_m or 0.0)
            case AMusselReleased.kind, {"full": True}:
                self.services += 1
            case RunEnded.kind, {"reason": str() as reason}:
                self.ended_by = reason


def figures_of(path: Path) -> RunFigures | None:
    """The figures of the run in a bag; None for a bag without one. BagUnreadable for a definition that makes no sense."""
    events, types = _Events(), RecordedTypes(str(path))
    uptimes = {
        TRUTH: _Uptimes(lambda row: not row.docked and row.primary > 0),
        BELIEFS: _Uptimes(lambda row: row.state not in DOCKED and row.charge > 0),
    }
    for message in recorded_messages(path):
        connection = message.connection
        if connection.kind not in (*uptimes, EVENT):
            continue
        (events if connection.kind == EVENT else uptimes[connection.kind]).take(types.read(message))
    name = next((name for name, kind in _SAMPLES.items() if uptimes[kind].seen), None)
    if name is None and not events.events:
        return None
    counts = uptimes[TRUTH if name is None else _SAMPLES[name]]
    shares = [100 * counts.up[it] / seen for it, seen in counts.seen.items()]
    total = counts.seen.total()
    return RunFigures(
        samples=name,
        ticks=len(counts.times_ms),
        ticks_missing=_missing(counts.times_ms),
        uptime_paper_mean=100 * counts.up.total() / total if total else None,
        uptime_paper_max=max(shares, default=None),
        uptime_paper_min=min(shares, default=None),
        cost_m=events.cost_m,
        services=events.services,
        events=len(events.events),
        ended_by=events.ended_by,
    )


def _missing(times_ms: set[int]) -> int:
    """Number of missing samples, by the most frequent period between samples."""
    spans = Counter(after - before for before, after in pairwise(sorted(times_ms)))
    if not spans:
        return 0
    period_ms, _ = spans.most_common(1)[0]
    return sum(count * (span // period_ms - 1) for span, count in spans.items())
