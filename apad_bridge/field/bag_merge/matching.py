"""Which messages two recordings have in common: the same bytes on the same topic.

Messages with a stamp or a counter are the only ones of their bytes, and pair by that alone; they tell the clocks' offset.
Others, such as a flag that is repeated, pair by the time at which they were heard once the offset is known.
"""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, field
from hashlib import blake2b
from pathlib import Path

import numpy as np

from apad_bridge.field.bag_merge.clocks import ClockOffset, clock_offset
from apad_bridge.records.bag import RecordedConnection, RecordedMessage, recorded_messages
from apad_bridge.records.bag_samples import BagUnreadable

_MAGIC = b"#ROSBAG V2.0"
_FARTHEST_S = 1.0
"""Two messages of the same bytes that were heard farther apart are two messages."""
_OF_PERIOD = 0.45
"""And so are two farther apart than this share of the period at which those bytes come."""
Key = tuple[str, str, bytes]


@dataclass(slots=True)
class Recording:
    """One bag: its messages' keys and times, in the order in which they were recorded."""

    path: Path
    keys: list[Key] = field(default_factory=list)
    times_s: list[float] = field(default_factory=list)
    connections: dict[tuple[str, str], RecordedConnection] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.keys)


@dataclass(frozen=True, slots=True)
class Matching:
    """The pairs of two recordings, and the offset of their clocks."""

    first: Recording
    second: Recording
    offset: ClockOffset
    partner: tuple[int, ...]
    """For each message of the second recording its place in the first one; -1 for one that is missing there."""

    def first_times_s(self, place: int) -> float:
        """The time of the second recording's message by the first one's clock."""
        time_s = self.second.times_s[place]
        return time_s - self.offset.at(place, time_s)


def read_recording(path: Path) -> Recording:
    """Reads a bag, closed or not. BagUnreadable, one line, for a file that is none, and for a bag without messages."""
    try:
        with path.open("rb") as file:
            is_bag = file.readline().rstrip(b"\n") == _MAGIC
        if not is_bag:
            raise BagUnreadable(f"{path}: not a ROS 1 bag")
        recording = Recording(path)
        for message in recorded_messages(path):
            recording.keys.append(key_of(message))
            recording.times_s.append(message.stamp_ns / 1e9)
            connection = message.connection
            recording.connections.setdefault((connection.topic, connection.kind), connection)
    except (OSError, KeyError) as error:
        raise BagUnreadable(f"{path}: not a bag that can be read: {error}") from error
    if not len(recording):
        raise BagUnreadable(f"{path}: there is no message in it")
    return recording


def key_of(message: RecordedMessage) -> Key:
    connection = message.connection
    return connection.topic, connection.md5, blake2b(message.data, digest_size=12).digest()


def match(first: Recording, second: Recording) -> Matching:
    """Pairs the messages of both. BagUnreadable when they have none in common that would tell the offset."""
    here, there = _places(first), _places(second)
    unique = [
        (places[0], here[key][0])
        for key, places in there.items()
        if len(places) == 1 == len(here.get(key, ()))
    ]
    unique.sort()
    if not (anchors := _rising(unique)):
        raise BagUnreadable(
            f"{first.path} and {second.path}: no message is in both that would tell their clocks' offset: are they of the "
            "same time and the same ROS graph?"
        )
    offset = clock_offset(
        [place for place, _ in anchors],
        [second.times_s[place] for place, _ in anchors],
        [second.times_s[place] - first.times_s[mate] for place, mate in anchors],
    )
    partner = [-1] * len(second)
    for place, mate in unique:
        partner[place] = mate
    matching = Matching(first, second, offset, ())
    for key, places in there.items():
        if (mates := here.get(key, [])) and not len(places) == 1 == len(mates):
            _pair_by_time(matching, mates, places, partner)
    return Matching(first, second, offset, tuple(partner))


def _places(recording: Recording) -> dict[Key, list[int]]:
    places: dict[Key, list[int]] = defaultdict(list)
    for place, key in enumerate(recording.keys):
        places[key].append(place)
    return places


def _rising(pairs: Sequence[tuple[int, int]]) -> list[tuple[int, int]]:
    """The longest part of the pairs whose order is the same in both: one that overtook others tells no offset."""
    tails: list[int] = []
    tail_at: list[int] = []
    before: list[int] = []
    for n, (_, mate) in enumerate(pairs):
        at = bisect_left(tails, mate)
        before.append(tail_at[at - 1] if at else -1)
        if at == len(tails):
            tails.append(mate)
            tail_at.append(n)
        else:
            tails[at], tail_at[at] = mate, n
    chain = []
    n = tail_at[-1] if tail_at else -1
    while n >= 0:
        chain.append(pairs[n])
        n = before[n]
    return chain[::-1]


def _pair_by_time(matching: Matching, mates: list[int], places: list[int], partner: list[int]) -> None:
    """Pairs messages of the same bytes that were heard at the same time, each with the earliest that is left."""
    heard = sorted((matching.first.times_s[it], it) for it in mates)
    times_s = [time_s for time_s, _ in heard]
    reach_s = _FARTHEST_S
    if len(heard) > 1:
        reach_s = min(reach_s, max(_OF_PERIOD * float(np.median(np.diff(times_s))), 1e-3))
    taken: set[int] = set()
    for place in places:
        time_s = matching.first_times_s(place)
        for n in range(bisect_left(times_s, time_s - reach_s), bisect_right(times_s, time_s + reach_s)):
            if n not in taken:
                taken.add(n)
                partner[place] = heard[n][1]
                break
