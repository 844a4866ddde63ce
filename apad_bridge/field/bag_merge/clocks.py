"""The offset of one recorder's clock from another's, as a function of the place in the recording.

Both recorders hear the same messages, each at its own time: the difference is the offset, plus the difference of what the
two ways took. Clocks drift a little, and step when one of them is set (a GPS that locks, NTP). So the offset is a straight
line between steps. Steps are found in the order of the recording, which no clock can turn. A link that loses packets delays
messages in bursts of seconds, which look like steps of some messages: then longer parts of the recording are compared.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
STEP_S = 0.25
"""The smallest step that is told from what the ways take."""
_SIDE = 12
"""Common messages on each side of a step, at least."""
_SIDE_S = 10.0
"""And seconds: a way that stands still for a second delays a dozen messages at once, in a busy recording. At either end of
the recording such a delay looks like a step for ever."""
_STEPS_AT_MOST = 3
_STEPS_AN_HOUR = 6
"""No clock is set more often than this, over `_STEPS_AT_MOST`: more steps are bursts of delayed messages."""
_MOST_FITTED = 400
_SHORTEST_S = 60.0
"""A drift is fitted to a stretch of at least this length; a shorter one has a constant offset."""


@dataclass(frozen=True, slots=True)
class Stretch:
    """A part of the recording between two steps: the offset is `offset_s + drift * (time - from_s)`."""

    first: int
    """The place in the second recording at which it begins."""
    from_s: float
    """A time by the second clock."""
    offset_s: float
    drift: float
    """Seconds per second."""
    spread_s: float
    """The median distance of the common messages from the line."""
    messages: int

    def offset_at(self, time_s: float) -> float:
        return self.offset_s + self.drift * (time_s - self.from_s)


@dataclass(frozen=True, slots=True)
class ClockOffset:
    """The second clock less the first one, in seconds, at each place of the second recording."""

    stretches: tuple[Stretch, ...]

    def at(self, place: int, time_s: float) -> float:
        """At a place in the second recording, whose message has this time by its clock."""
        firsts = [it.first for it in self.stretches]
        return self.stretches[max(0, bisect_right(firsts, place) - 1)].offset_at(time_s)

    @property
    def steps_s(self) -> list[float]:
        """Sizes of the clocks' steps, in order."""
        return [
            after.offset_at(after.from_s) - before.offset_at(after.from_s)
            for before, after in pairwise(self.stretches)
        ]


def clock_offset(places: Sequence[int], times_s: Sequence[float], offsets_s: Sequence[float]) -> ClockOffset:
    """The offset from the messages that both have, in the order of the second recording.

    `places` and `times_s` are theirs in the second recording, `offsets_s` the second clock's time less the first one's.
    ValueError for no message.
    """
    if not len(places):
        raise ValueError("the recordings have no message in common")
    offsets, times = np.asarray(offsets_s, dtype=float), np.asarray(times_s, dtype=float)
    bounds = [0, *_steps_of_clocks(times, offsets), len(offsets)]
    stretches = []
    for begin, end in pairwise(bounds):
        first = 0 if begin == 0 else _place_of_step(places, begin)
        stretches.append(_stretch(first, times[begin:end], offsets[begin:end]))
    return ClockOffset(tuple(stretches))


def _steps_of_clocks(times_s: Floats, offsets: Floats) -> list[int]:
    """The first message after each step, by the shortest parts of the recording in which no more steps are found than
    clocks make."""
    at_most = _STEPS_AT_MOST + _STEPS_AN_HOUR * float(np.ptp(times_s)) / 3600
    block = max(1, -int(-_SIDE_S * len(offsets) // (_SIDE * max(_SIDE_S, float(np.ptp(times_s))))))
    while len(found := _steps_by_blocks(offsets, block)) > at_most:
        block *= 2
    return found


def _steps_by_blocks(offsets: Floats, block: int) -> list[int]:
    """The steps between blocks of so many messages; each block counts as its median."""
    if block == 1:
        return _steps(offsets)
    count = len(offsets) // block
    medians = np.median(offsets[: count * block].reshape(count, block), axis=1)
    found = []
    for cut in _steps(medians):
        first, last = (cut - 1) * block, min((cut + 1) * block, len(offsets) - 1)
        found.append(_best_cut(offsets, first, last, _SIDE * block))
    return found


def _steps(offsets: Floats) -> list[int]:
    """The first value after each step: the median of the next values differs from that of the last ones."""
    if len(offsets) < 2 * _SIDE:
        return []
    windows = np.lib.stride_tricks.sliding_window_view(offsets, _SIDE)
    medians = np.median(windows, axis=1)
    # Of the windows that end before a message, and those that begin with it.
    contrast = np.abs(medians[_SIDE:] - medians[:-_SIDE])
    found: list[int] = []
    place = 0
    while place < len(contrast):
        if contrast[place] <= STEP_S:
            place += 1
            continue
        end = place
        while end < len(contrast) and contrast[end] > STEP_S:
            end += 1
        found.append(_best_cut(offsets, place + _SIDE, end - 1 + _SIDE, _SIDE))
        place = end
    return found


def _best_cut(offsets: Floats, first: int, last: int, side: int) -> int:
    """The cut in [first, last] whose two sides, of `side` values or more, lie closest to their medians."""
    begin, end = max(0, first - side), min(len(offsets), last + side)

    def misfit(cut: int) -> float:
        before, after = offsets[begin:cut], offsets[cut:end]
        return float(np.abs(before - np.median(before)).sum() + np.abs(after - np.median(after)).sum())

    return min(range(first, last + 1), key=misfit)


def _place_of_step(places: Sequence[int], cut: int) -> int:
    """Half-way between the last common message before the step and the first one after it."""
    return (places[cut - 1] + places[cut] + 1) // 2


def _stretch(first: int, times_s: Floats, offsets_s: Floats) -> Stretch:
    every = -(-len(times_s) // _MOST_FITTED)
    from_s, drift, offset_s = float(times_s[0]), 0.0, float(np.median(offsets_s))
    if np.ptp(times_s) >= _SHORTEST_S:
        drift = _slope(times_s[::every], offsets_s[::every])
        offset_s = float(np.median(offsets_s - drift * (times_s - from_s)))
    misses = np.abs(offsets_s - offset_s - drift * (times_s - from_s))
    return Stretch(first, from_s, offset_s, drift, float(np.median(misses)), len(offsets_s))


def _slope(times_s: Floats, offsets_s: Floats) -> float:
    """The median of the slopes between all pairs (Theil and Sen), which late messages do not bend."""
    first, second = np.triu_indices(len(times_s), 1)
    spans = times_s[second] - times_s[first]
    apart = spans > 0
    if not apart.any():
        return 0.0
    return float(np.median((offsets_s[second] - offsets_s[first])[apart] / spans[apart]))
