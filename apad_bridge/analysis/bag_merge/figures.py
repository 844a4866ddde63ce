"""The figures of a run, counted again from a bag alone: from what was sampled of truths, and from the mission's events.

A bag that lacks ticks gives them from the ticks that it has, and says how many those are.
"""

from __future__ import annotations

import json
from collections import Counter
from dataclasses import asdict, dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from apad_bridge.records.bag import RecordedConnection, recorded_messages
from apad_bridge.records.bag_messages import EVENT, TRUTH
from apad_bridge.records.bag_samples import BagUnreadable
from apad_bridge.records.event_kinds import EventKind


@dataclass(frozen=True, slots=True)
class RunFigures:
    """As in summary.json, where a figure has the same name; None for what the bag does not tell."""

    ticks: int
    """Mission times of which the bag has a sample of the truth."""
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

    def to_json(self) -> dict[str, Any]:
        return asdict(self)


class _Counts:
    def __init__(self) -> None:
        self.times_ms: set[int] = set()
        self.seen: Counter[int] = Counter()
        self.up: Counter[int] = Counter()
        self.events: set[tuple[int, str, str]] = set()
        self.cost_m: float | None = None
        self.services = 0
        self.ended_by: str | None = None

    def take_truth(self, message: Any) -> None:
        # The mission's ticks begin after its start, as in summary.json.
        if message.mission_time_ms == 0 or message.mission_time_ms in self.times_ms:
            return
        self.times_ms.add(message.mission_time_ms)
        for row in message.agents:
            self.seen[row.id] += 1
            self.up[row.id] += not row.docked and row.primary > 0

    def take_event(self, message: Any) -> None:
        event = message.mission_time_ms, message.kind, message.data
        if event in self.events:
            return
        self.events.add(event)
        try:
            data = json.loads(message.data)
        except ValueError:
            return
        match message.kind, data:
            case EventKind.MISSION, {"snapshot": {"cost_m": float() | int() as cost_m}}:
                self.cost_m = max(cost_m, self.cost_m or 0.0)
            case EventKind.RELEASED, {"full": True}:
                self.services += 1
            case EventKind.END, {"reason": str() as reason}:
                self.ended_by = reason


def figures_of(path: Path) -> RunFigures | None:
    """The figures of the run in a bag; None for a bag without one. BagUnreadable for a definition that makes no sense."""
    counts, stores = _Counts(), dict[str, Typestore]()
    for message in recorded_messages(path):
        connection = message.connection
        if connection.kind not in (TRUTH, EVENT):
            continue
        if connection.md5 not in stores:
            stores[connection.md5] = _store(path, connection)
        read = stores[connection.md5].deserialize_ros1(message.data, connection.kind)
        if connection.kind == TRUTH:
            counts.take_truth(read)
        else:
            counts.take_event(read)
    if not counts.times_ms and not counts.events:
        return None
    shares = [100 * counts.up[it] / seen for it, seen in counts.seen.items()]
    total = counts.seen.total()
    return RunFigures(
        len(counts.times_ms),
        _missing(counts.times_ms),
        100 * counts.up.total() / total if total else None,
        max(shares, default=None),
        min(shares, default=None),
        counts.cost_m,
        counts.services,
        len(counts.events),
        counts.ended_by,
    )


def _missing(times_ms: set[int]) -> int:
    """How many samples are missing, where they come at the period that is the most frequent."""
    ordered = sorted(times_ms)
    spans = Counter(after - before for before, after in pairwise(ordered))
    if not spans:
        return 0
    period_ms, _ = spans.most_common(1)[0]
    return sum(count * (span // period_ms - 1) for span, count in spans.items())


def _store(path: Path, connection: RecordedConnection) -> Typestore:
    store = get_typestore(Stores.ROS1_NOETIC)
    try:
        types = get_types_from_msg(connection.definition, connection.kind)
    except Exception as error:
        raise BagUnreadable(f"{path}: its definition of {connection.kind} makes no sense") from error
    store.register({name: fields for name, fields in types.items() if name not in store.types})
    return store
