"""samples.jsonl: the samples that aMussels uploaded, one a line, appended; and the summary's counts of samples.

A line is on disk before its record is acknowledged. So an aMussel forgets nothing that is not in the file, whatever kills
the supervisor, or cuts its power. Counts are raw, and values come from the built-in calibrations.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Mapping, Sequence, Set
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

from agents.time_scale import TimeScale
from apad_bridge.mission.facts import PlacedSample, SampleSource
from apad_bridge.records.line_file import Line, LineFile, LineTail, read_lines
from firmware_model.sampling.flash import PAGE_BYTES, PAGES, Ring
from firmware_model.sampling.sensors import SENSORS, values


class KeptSample(NamedTuple):
    """A line of the file. `columns` has all of it, by the names that the docs give."""

    agent_id: int
    sequence: int
    columns: Mapping[str, Any]

    @property
    def board(self) -> SampleSource:
        return SampleSource(self.agent_id, self.columns.get("real_since_ms"))


class SampleTail:
    """Reads a file of samples that grows, and that is there from the first sample on."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._tail: LineTail | None = None

    def new_samples(self) -> Iterator[KeptSample]:
        """The samples of the whole lines that were written since the last call; damaged lines are left out."""
        if self._tail is None and self._path.is_file():
            self._tail = LineTail(self._path)
        return _readable(line for _, line in (() if self._tail is None else self._tail.read_new()))

    def close(self) -> None:
        if self._tail is not None:
            self._tail.close()


def read_samples(path: Path) -> Iterator[KeptSample]:
    """The samples of a file; damaged lines are left out. None without such a file."""
    return _readable(read_lines(path) if path.is_file() else ())


def _readable(lines: Iterable[Line | None]) -> Iterator[KeptSample]:
    return (it for line in lines if (it := _sample_in(line)) is not None)


def _sample_in(line: Line | None) -> KeptSample | None:
    """None for a damaged line."""
    if line is None or type(line.get("id")) is not int or type(line.get("sequence")) is not int:
        return None
    if type(line.get("real_since_ms", 0)) is not int:
        return None
    return KeptSample(line["id"], line["sequence"], line)


SAMPLE_KEYS = ("samples_taken", "samples_uploaded", "samples_lost", "samples_waiting")


class SampleFile:
    """The file with a run's samples. The first sample creates it; a last line that a kill tore is cut off."""

    def __init__(self, path: Path, scale: TimeScale) -> None:
        self._path = path
        self._scale = scale
        self._file: LineFile | None = None
        self.kept: dict[SampleSource, set[int]] = {}
        """The sequence numbers in the file."""
        self.unreadable = 0
        """The number of damaged lines: their samples are accepted again, if the aMussels still have them."""
        if path.exists():
            self._file = LineFile(path)
            for line in read_lines(path):
                if (sample := _sample_in(line)) is None:
                    self.unreadable += 1
                else:
                    self.kept.setdefault(sample.board, set()).add(sample.sequence)

    def append(self, board: SampleSource, samples: Iterable[PlacedSample]) -> None:
        """Writes the samples that are not in the file yet; they are on disk when it returns. FileGone for a lost file."""
        kept = self.kept.setdefault(board, set())
        new = [sample for sample in samples if sample.record.sequence not in kept]
        if not new:
            return
        if self._file is None:
            self._file = LineFile(self._path)
            _sync_directory(self._path.parent)
        for sample in new:
            self._file.append(sample_line(board, sample, self._scale))
        self._file.flush()
        self._file.sync()
        self._file.refuse_gone()
        kept.update(sample.record.sequence for sample in new)

    def close(self) -> None:
        """Closes the file; a second call does nothing."""
        if self._file is not None:
            self._file.close()


def _sync_directory(path: Path) -> None:
    """Returns when the names in the directory survive a power cut."""
    descriptor = os.open(path, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def sample_line(board: SampleSource, sample: PlacedSample, scale: TimeScale) -> Line:
    """A sample's line: times, place, values in their units, raw counts, and the readings outside their sensor's range.

    `agent_ms` is the reading of the board's clock, and `mission_ms` its mission time if the clock was right.
    The place is the supervisor's belief, and null where it had none. Only a real one that took the id has `real_since_ms`.
    """
    record = sample.record
    north_m, east_m = sample.place_m or (None, None)
    readings = zip(SENSORS, values(SENSORS, record.counts), strict=True)
    return {
        "id": board.agent_id,
        **({} if board.real_since_ms is None else {"real_since_ms": board.real_since_ms}),
        "sequence": record.sequence,
        "agent_ms": record.agent_ms,
        "mission_ms": round(scale.mission_time(record.agent_ms)),
        "north_m": None if north_m is None else round(north_m, 2),
        "east_m": None if east_m is None else round(east_m, 2),
        **{sensor.key: round(value, 4) for sensor, value in readings},
        "counts": list(record.counts),
        "saturated": [it.name for place, it in enumerate(SENSORS) if record.saturated >> place & 1],
    }


def sample_figures(
    taken: Mapping[int, int],
    kept: Mapping[SampleSource, Set[int]],
    gone: Mapping[SampleSource, Set[int]],
    apart: Mapping[int, Sequence[range]] = MappingProxyType({}),
) -> dict[str, Any]:
    """The summary's counts of samples taken, uploaded, lost and waiting.

    `taken` comes from the truth. It is empty where there is no truth, and then only uploads and reported losses are known.

    `apart` has the sequences that a real aMussel's twin took, or an aMussel out of the water: they are not counted. Nor are
    samples that a real aMussel uploaded under a simulated one's id.

    A sample is one reading of all sensors, written into the log. A sample is lost if the log overwrote it before its
    upload, even if nobody knows of it, or if it became unreadable.
    """
    if not taken:
        uploaded, lost = (sum(map(len, it.values())) for it in (kept, gone))
        return dict(zip(SAMPLE_KEYS, (None, uploaded, lost, None), strict=True))
    ring, nothing = Ring(PAGES, PAGE_BYTES), frozenset[int]()
    total = uploaded = lost = 0
    for agent_id, count in taken.items():
        own = set(range(count)).difference(*apart.get(agent_id, ()))
        uploads = own & kept.get(SampleSource(agent_id), nothing)
        gone_samples = (own & gone.get(SampleSource(agent_id), nothing)) | (
            own & set(range(ring.oldest(count)))
        )
        total, uploaded, lost = total + len(own), uploaded + len(uploads), lost + len(gone_samples - uploads)
    return dict(zip(SAMPLE_KEYS, (total, uploaded, lost, total - uploaded - lost), strict=True))
