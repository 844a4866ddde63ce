"""One bag of two that recorded the same ROS graph on two machines, and what each of them lacks."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from apad_bridge.field.bag_merge.bag_figures import RunFigures, figures_of
from apad_bridge.field.bag_merge.matching import Matching, match, read_recording
from apad_bridge.records.bag import RecordedConnection, new_bag, recorded_messages

GAP_S = 5.0
"""A recorder that lacks everything for so long has a gap."""


@dataclass(frozen=True, slots=True)
class TopicCounts:
    topic: str
    first: int
    second: int
    both: int

    @property
    def missing_in_first(self) -> int:
        return self.second - self.both

    @property
    def missing_in_second(self) -> int:
        return self.first - self.both


@dataclass(frozen=True, slots=True)
class Gap:
    """A stretch in which one recorder lacks everything that the other has; times by the first one's clock."""

    in_first: bool
    from_s: float
    to_s: float
    messages: int


@dataclass(frozen=True, slots=True)
class Merge:
    """Result of a merge. The figures are None for a bag without a run of musselbed in it."""

    matching: Matching
    topics: tuple[TopicCounts, ...]
    gaps: tuple[Gap, ...]
    merged_messages: int
    figures_of_first: RunFigures | None
    figures_of_second: RunFigures | None
    figures_of_merged: RunFigures | None

    def to_json(self) -> dict[str, Any]:
        figures = {
            "first": self.figures_of_first,
            "second": self.figures_of_second,
            "merged": self.figures_of_merged,
        }
        offset = self.matching.offset
        return {
            "messages": {
                "first": len(self.matching.first),
                "second": len(self.matching.second),
                "both": sum(it.both for it in self.topics),
                "merged": self.merged_messages,
            },
            "clock": [
                {
                    "from_s": it.from_s,
                    "offset_s": it.offset_s,
                    "drift_ppm": 1e6 * it.drift,
                    "spread_s": it.spread_s,
                    "messages": it.messages,
                }
                for it in offset.stretches
            ],
            "steps_s": offset.steps_s,
            "topics": {
                it.topic: {
                    "first": it.first,
                    "second": it.second,
                    "both": it.both,
                    "missing_in_first": it.missing_in_first,
                    "missing_in_second": it.missing_in_second,
                }
                for it in self.topics
            },
            "gaps": [
                {
                    "in": "first" if it.in_first else "second",
                    "from_s": it.from_s,
                    "to_s": it.to_s,
                    "messages": it.messages,
                }
                for it in self.gaps
            ],
            "figures": {name: None if it is None else asdict(it) for name, it in figures.items()},
        }


def merge(first: Path, second: Path, out: Path) -> Merge:
    """Merges two bags into `out`, by the first one's clock: all of the first, and what only the second has.

    It is written beside `out` and renamed. BagUnreadable for a bag that cannot be read, or that has nothing in common
    with the other; OSError when `out` cannot be written.
    """
    matching = match(read_recording(first), read_recording(second))
    fresh = out.with_name(f".{out.name}.unfinished")
    fresh.unlink(missing_ok=True)
    try:
        merged = _write(matching, fresh)
        os.replace(fresh, out)
    finally:
        fresh.unlink(missing_ok=True)
    return Merge(
        matching=matching,
        topics=_topics(matching),
        gaps=tuple(_gaps(matching)),
        merged_messages=merged,
        figures_of_first=figures_of(first),
        figures_of_second=figures_of(second),
        figures_of_merged=figures_of(out),
    )


def _write(matching: Matching, path: Path) -> int:
    """Writes the merged bag in the order in which messages were recorded; returns how many."""
    writer = new_bag(path)
    connections: dict[tuple[str, str], Any] = {}

    def write(connection: RecordedConnection, stamp_ns: int, data: bytes) -> None:
        name = connection.topic, connection.md5
        if name not in connections:
            connections[name] = writer.add_connection(
                connection.topic, connection.kind, msgdef=connection.definition, md5sum=connection.md5
            )
        writer.write(connections[name], max(1, stamp_ns), data)

    written, newest = 0, -1
    here = enumerate(recorded_messages(matching.first.path))

    def write_first_up_to(last: int) -> Iterator[None]:
        nonlocal newest
        while newest < last:
            newest, message = next(here)
            write(message.connection, message.stamp_ns, message.data)
            yield

    try:
        for place, message in enumerate(recorded_messages(matching.second.path)):
            if (mate := matching.partner[place]) >= 0:
                written += sum(1 for _ in write_first_up_to(mate))
            else:
                write(message.connection, round(1e9 * matching.first_times_s(place)), message.data)
                written += 1
        written += sum(1 for _ in write_first_up_to(len(matching.first) - 1))
    finally:
        writer.close()
    return written


def _topics(matching: Matching) -> tuple[TopicCounts, ...]:
    first = Counter(topic for topic, _, _ in matching.first.keys)
    second = Counter(topic for topic, _, _ in matching.second.keys)
    both = Counter(matching.second.keys[place][0] for place, mate in enumerate(matching.partner) if mate >= 0)
    return tuple(
        TopicCounts(topic, first[topic], second[topic], both[topic]) for topic in sorted(first | second)
    )


def _gaps(matching: Matching) -> Iterator[Gap]:
    """The gaps of both recorders, in the order of the recording."""
    has_mate = {mate for mate in matching.partner if mate >= 0}
    yield from _runs(
        [mate >= 0 for mate in matching.partner],
        [matching.first_times_s(place) for place in range(len(matching.second))],
        in_first=True,
    )
    yield from _runs(
        [place in has_mate for place in range(len(matching.first))], matching.first.times_s, in_first=False
    )


def _runs(is_in_both: list[bool], times_s: list[float], *, in_first: bool) -> Iterator[Gap]:
    begin: int | None = None
    for place, common in enumerate([*is_in_both, True]):
        if not common:
            begin = place if begin is None else begin
        elif begin is not None:
            if times_s[place - 1] - times_s[begin] >= GAP_S:
                yield Gap(in_first, times_s[begin], times_s[place - 1], place - begin)
            begin = None
